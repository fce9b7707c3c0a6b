"""A delay of the link's encoder: what passes for it, and what it passes for itself.

It may pass for a spring (`Skew`). Where the motor's row says little of it or is not there, it
passes for damping and friction.

A joint looks the same at any time: what a late encoder shows is the motion of a link whose motor
moved later. With a delay τ the link seems to obey, to first order in τ,

    x1'' = … - θ2 (x1 - x3) - θ2 τ x4,

and -θ2 τ x4 = θ2 τ (x2 - x4) - θ2 τ x2: a damping of the joint that is lower by θ2 τ beside a
friction of the link that is higher by as much. The motor's row would say which of the two it is;
the link alone cannot. What it can tell is their signs, since neither is ever negative:

- where both fit as they are, the delay is taken to be none, and the intervals span what the signs
  leave possible;
- where one comes out negative, the delay makes up for it, and that one is taken to be none;
- where the spring comes out negative, damping has taken the part of the delay altogether, and both
  are taken to be none beside it.

A motor whose friction no term describes says little more: there an encoder that is early by just
what makes its link's friction none is a damping of the joint.
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
"""What a delay passes for."""

_STIFFNESS = "theta2"

_LITTLE = 0.1  # of a friction, that is left of it beside a damping: a model's error leaves 0.001
_CHANCE = 0.5  # that there is a delay at all, before the log was seen
_PARTS = 10  # of a log, whose delays differ by as much as they are uncertain
_MOSTLY = 0.8  # share of the deflection's variance; of a spring's motion less is in one phase


def doubtful(values: Mapping[str, float]) -> frozenset[str]:
    """Which of damping and friction came out as no drive has them.

    Neither is to be trusted where the spring itself came out negative.
    """
    if values.get(_STIFFNESS, np.inf) <= 0.0:
        return frozenset(CONFUSED)
    return frozenset(name for name in CONFUSED if values.get(name, 0.0) < 0.0)


def possible(values: Mapping[str, float]) -> tuple[float, float]:
    """Ends in s of the further delay that the signs of damping and friction leave possible."""
    stiffness = values.get(_STIFFNESS, 0.0)
    if stiffness <= 0.0:
        return 0.0, 0.0
    damping, friction = (max(values.get(name, 0.0), 0.0) for name in CONFUSED)
    return -damping / stiffness, friction / stiffness


def is_damping(values: Mapping[str, float]) -> bool:
    """Whether an early encoder and a friction of its link are but one damping of the joint."""
    delay, friction = values.get(LINK, 0.0), values.get(FRICTION, 0.0)
    left = friction + values.get(_STIFFNESS, 0.0) * delay
    return delay < 0.0 and abs(left) <= _LITTLE * friction


def confused_covariance(estimate: Estimate) -> FloatArray:
    """Covariance, shape (k, k), that a further delay adds: one is there as likely as not.

    If there is one, it may be any that the signs leave possible.
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
    """An alignment whose link delay is what the signs of damping and friction leave possible."""
    delay = alignment.link_delay
    if LINK in estimate.names:
        _, std, freedom = estimate.of(LINK)
        ends = interval(delay.value, std, freedom)
        return replace(alignment, link_delay=replace(delay, std=std, interval=ends))
    return replace(alignment, link_delay=replace(delay, interval=possible(estimate.by_name)))


@dataclass(frozen=True)
class Skew:
    """A delay between the encoders, in place of a spring."""

    delay: float  # in s, that explains most of the deflection
    deviation: float  # its standard deviation in s, from the spread between parts of the log
    explained: float  # its share of the deflection's variance
    excess: float  # what it leaves, as a mean square over that of the deflection's noise
    by_spring: float  # share of what it leaves that goes with the link's acceleration

    @property
    def makes_the_deflection(self) -> bool:
        """Whether a delay explains so much of the deflection that no spring is known.

        What it leaves may be little, and still all that a spring does.
        """
        return self.explained > _MOSTLY > self.by_spring

    def delays_the_link(self, alignment: Alignment) -> Alignment:
        """An alignment in which the link's encoder is late by this, which the fit took as given."""
        ends = interval(self.delay, self.deviation, _PARTS - 1)
        return replace(alignment, link_delay=Delay(self.delay, self.deviation, ends, "found"))


def skew(joint: Joint, data: Data) -> Skew:
    """What a delay between the encoders makes of the deflection."""
    rows, left, noise, count = [], [], 0.0, sum(map(len, data.samples))
    for samples in data.samples:
        assert samples.velocities is not None
        speed, acceleration = samples.velocities[:, -1], np.gradient(samples.velocities[:, 0])
        rows.append(np.column_stack((speed - speed.mean(), acceleration)))
        deflection = joint.channels_of(samples.positions, samples.inputs)[:, -1]
        left.append(deflection - deflection.mean())
        noise += len(samples) / count * position_noise(deflection) ** 2
    regressors, deflection = np.concatenate(rows), np.concatenate(left)
    solution = np.linalg.lstsq(regressors, deflection)[0]
    parts = zip(*(np.array_split(each, _PARTS) for each in (regressors, deflection)), strict=True)
    delays = [np.linalg.lstsq(rows_of, of_part)[0][0] for rows_of, of_part in parts]
    late = deflection - regressors[:, 0] * solution[0]
    remaining = float(np.var(late))
    beyond = (
        float(np.var(late - regressors[:, 1] * solution[1])) if solution[1] < 0.0 else remaining
    )
    least = np.finfo(float).tiny
    return Skew(
        -float(solution[0]),
        float(np.std(delays, ddof=1)) / np.sqrt(_PARTS),
        1.0 - remaining / max(float(np.var(deflection)), least),
        remaining / max(noise, least),
        1.0 - beyond / max(remaining, least),
    )


def shifted(data: Data, delay: float) -> Data:
    """A log whose link's positions are put a delay earlier."""
    moved = []
    for samples in data.samples:
        positions = samples.positions.copy()
        assert samples.velocities is not None
        positions[:, 0] += delay * samples.velocities[:, 0]
        moved.append(replace(samples, positions=positions))
    return replace(data, samples=tuple(moved))
