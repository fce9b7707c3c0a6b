"""Delay of the link's encoder, and the terms that it can be confused with.

A delay may look like a spring (`Skew`). If the motor's row is missing or explains little, a delay
also looks like damping and friction.

With a late encoder the link seems to follow a motor that moved later. With a delay τ it obeys, to
first order in τ,

    x1'' = … - θ2 (x1 - x3) - θ2 τ x4,

and -θ2 τ x4 = θ2 τ (x2 - x4) - θ2 τ x2. This is a damping of the joint that is lower by θ2 τ, and a
friction of the link that is higher by θ2 τ. The motor's row would show which of the two it is, but
the link alone does not. Only the signs help, since neither coefficient is negative in a real drive:

- if both come out positive, the delay is taken as zero, and the intervals span all delays that the
  signs allow;
- if one comes out negative, it is taken as zero, and the delay is fitted;
- if the stiffness comes out negative, damping has replaced the delay: damping and friction are
  taken as zero, and the delay is fitted.

A motor with a friction that no term describes helps little. Then an early encoder whose delay
cancels the link's friction is equivalent to a damping of the joint.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.full_model.model import LINK, Data
from flexid.identification.preparation.joint import Joint
from flexid.identification.preparation.recordings import Alignment, Delay
from flexid.identification.vocabulary.evidence import Estimate, interval
from flexid.recording.velocities import position_noise

CONFUSED = DAMPING, FRICTION = "theta_damping", "theta_viscous"
"""Coefficients that a delay is confused with."""

_STIFFNESS = "theta2"

_LITTLE = 0.1  # largest share of a friction that is left with a damping; a model error leaves 0.001
_CHANCE = 0.5  # prior probability of a delay
_PARTS = 10  # parts of a log, whose delays show the uncertainty
_MOSTLY = 0.8  # share of the deflection's variance; a spring's motion is less in one phase


def doubtful(values: Mapping[str, float]) -> frozenset[str]:
    """Return which of damping and friction came out negative; both if the stiffness did."""
    if values.get(_STIFFNESS, np.inf) <= 0.0:
        return frozenset(CONFUSED)
    return frozenset(name for name in CONFUSED if values.get(name, 0.0) < 0.0)


def possible(values: Mapping[str, float]) -> tuple[float, float]:
    """Return the range in s of further delays that the signs of damping and friction allow."""
    stiffness = values.get(_STIFFNESS, 0.0)
    if stiffness <= 0.0:
        return 0.0, 0.0
    damping, friction = (max(values.get(name, 0.0), 0.0) for name in CONFUSED)
    return -damping / stiffness, friction / stiffness


def is_damping(values: Mapping[str, float]) -> bool:
    """Whether an early encoder and a friction of its link are equivalent to joint damping."""
    delay, friction = values.get(LINK, 0.0), values.get(FRICTION, 0.0)
    left = friction + values.get(_STIFFNESS, 0.0) * delay
    return delay < 0.0 and abs(left) <= _LITTLE * friction


def confused_covariance(estimate: Estimate) -> FloatArray:
    """Return the covariance, shape (k, k), from a further delay, present with probability 1/2.

    The delay is uniformly distributed over the range that the signs allow.
    """
    values = estimate.by_name
    lower, upper = possible(values)
    mean_square = _CHANCE * (lower**2 + lower * upper + upper**2) / 3.0
    slopes = {
        DAMPING: values.get(_STIFFNESS, 0.0),
        FRICTION: -values.get(_STIFFNESS, 0.0),
        LINK: 1.0,
    }
    direction = np.array([slopes.get(name, 0.0) for name in estimate.names])
    return mean_square * np.outer(direction, direction)


def in_doubt(alignment: Alignment, estimate: Estimate) -> Alignment:
    """Return the alignment with the link delay's interval, fitted or from the allowed signs."""
    delay = alignment.link_delay
    if LINK in estimate.names:
        _, std, freedom = estimate.of(LINK)
        ends = interval(delay.value, std, freedom)
        return replace(alignment, link_delay=replace(delay, std=std, interval=ends))
    return replace(alignment, link_delay=replace(delay, interval=possible(estimate.by_name)))


@dataclass(frozen=True)
class Skew:
    """Delay between the encoders that explains the deflection in place of a spring."""

    delay: float  # in s
    deviation: float  # standard deviation in s, from the spread between parts of the log
    explained: float  # explained share of the deflection's variance
    excess: float  # mean square of the remainder over the deflection's noise
    by_spring: float  # share of the remainder, or of that without gravity, by the acceleration

    @property
    def makes_the_deflection(self) -> bool:
        """Whether the delay explains so much of the deflection that it shows no spring.

        A small remainder may still be a spring, if the link's acceleration explains it.
        """
        return self.explained > _MOSTLY > self.by_spring

    def delays_the_link(self, alignment: Alignment) -> Alignment:
        """Return the alignment with this delay as the link's, which the fit took as given."""
        ends = interval(self.delay, self.deviation, _PARTS - 1)
        return replace(alignment, link_delay=Delay(self.delay, self.deviation, ends, "found"))


def skew(joint: Joint, data: Data) -> Skew:
    """Fit a delay between the encoders to the deflection."""
    rows, left, noise, count = [], [], 0.0, sum(map(len, data.samples))
    for samples in data.samples:
        assert samples.velocities is not None
        speed, acceleration = samples.velocities[:, -1], np.gradient(samples.velocities[:, 0])
        link = samples.positions[:, 0]
        gravity = (np.sin(link), np.cos(link)) if joint.type == "revolute" else ()
        row = np.column_stack((speed, acceleration, *gravity))
        rows.append(row - row.mean(axis=0))
        deflection = joint.channels_of(samples.positions, samples.inputs)[:, -1]
        left.append(deflection - deflection.mean())
        noise += len(samples) / count * position_noise(deflection) ** 2
    regressors, deflection = np.concatenate(rows), np.concatenate(left)
    solution = np.linalg.lstsq(regressors, deflection)[0]
    parts = zip(*(np.array_split(each, _PARTS) for each in (regressors, deflection)), strict=True)
    delays = [np.linalg.lstsq(rows_of, of_part)[0][0] for rows_of, of_part in parts]
    late = deflection - regressors[:, 0] * solution[0]
    remaining = float(np.var(late))
    least = np.finfo(float).tiny
    # An eccentric encoder looks like gravity, so gravity is no evidence of a spring. It may hide
    # the acceleration, or, in a small swing at one frequency, replace it.
    by_spring = max(_by_first(late, regressors[:, 1 : 1 + n]) for n in (1, regressors.shape[1]))
    return Skew(
        -float(solution[0]),
        float(np.std(delays, ddof=1)) / np.sqrt(_PARTS),
        1.0 - remaining / max(float(np.var(deflection)), least),
        remaining / max(noise, least),
        by_spring,
    )


def _by_first(target: FloatArray, regressors: FloatArray) -> float:
    """Return the share that a negative first regressor explains of what the others leave."""
    own, others = regressors[:, 0], regressors[:, 1:]
    rest, first = (each - others @ np.linalg.lstsq(others, each)[0] for each in (target, own))
    square, product = float(first @ first), float(first @ rest)
    return product**2 / (square * float(rest @ rest)) if product < 0.0 < square else 0.0


def shifted(data: Data, delay: float) -> Data:
    """Return the log with the link, or a deflection sensor, moved earlier by a delay in s."""
    moved = []
    for samples in data.samples:
        positions = samples.positions.copy()
        assert samples.velocities is not None
        late = samples.velocities[:, 0]
        if data.relative_to:  # to the motor, whose velocity is a state or the second input
            rates = samples.velocities if samples.velocities.shape[1] > 1 else samples.inputs
            late = late - rates[:, 1]
        positions[:, 0] += delay * late
        moved.append(replace(samples, positions=positions))
    return replace(data, samples=tuple(moved))
