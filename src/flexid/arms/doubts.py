"""What may be wrong with the fit of a disturbed arm that its likelihood does not show.

Each doubt says by how much the values may be off, as directions of errors, shape (k, m), like those
of one joint in `flexid.identification.estimation.doubts`. Most change the log, and look where the
fit goes.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexid.arms.disturbed import NEAR_STEPS, RIVAL, DisturbedFit, Job
from flexid.arms.fitting import effect_sizes
from flexid.arms.play import changes_by_play
from flexid.arms.unusual import FittedArm, link_delays
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.samples import Samples
from flexid.estimators.threads import cores
from flexid.identification.estimation.doubts import (
    CALIBRATION,
    Repeat,
    between_bands,
    between_halves,
    like_a_term,
)
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.torque_balance import JointTerm
from flexid.recording.shift import later
from flexid.recording.velocities import position_noise

_SEED = 1  # of the noise that is added to inputs
_NEVER_NEGATIVE = ("friction", "damping", "coupling")  # but as a sign of something else


@dataclass(frozen=True, eq=False)
class Doubted:
    """A fit, and what the doubts look at."""

    disturbed: DisturbedFit

    @property
    def job(self) -> Job:
        """What was fitted."""
        return self.disturbed.job

    @property
    def fitted(self) -> FittedArm:
        """The fit."""
        return self.disturbed.fitted

    @property
    def values(self) -> FloatArray:
        """What was sought, shape (k,)."""
        return self.fitted.values

    @property
    def estimate(self) -> Estimate:
        """The same with its covariance."""
        return self.disturbed.estimate

    @cached_property
    def white_noise(self) -> FloatArray:
        """Noise of each input that its motor's disturbance would be, shape (n_joints,)."""
        sizes, values = self.disturbed.best.sizes, self.disturbed.values
        sample_time = max(recording.sample_time for recording in self.job.data.samples)
        joints = range(1, self.job.balance.joints + 1)
        gains = np.array([abs(values[f"torque_constant_{joint}"]) for joint in joints])
        torques = self.disturbed.disturbing_torques()[1::2]
        spectra = 2.0 / (sizes.rates[1::2] * sample_time)  # over that of white noise of that size
        return torques * np.sqrt(spectra) / np.maximum(gains, 1e-12)

    @cached_property
    def timely(self) -> tuple[Samples, ...]:
        """The log with each link's position moved to when it was true."""
        delays = self.disturbed.values
        late = [delays.get(name, 0.0) for name in link_delays(self.job.balance)]
        if not any(late):
            return self.job.data.samples
        return tuple(_moved(recording, late) for recording in self.job.data.samples)

    @cached_property
    def input_noise(self) -> FloatArray:
        """Noise of each input that may be in the log alone, shape (n_joints,)."""
        logged = [[position_noise(c) for c in r.inputs.T] for r in self.job.data.samples]
        return np.minimum(np.max(logged, axis=0), self.white_noise)


def _moved(recording: Samples, late: Sequence[float]) -> Samples:
    """A recording whose links' positions, every second one, were measured so much later."""
    positions = recording.positions.copy()
    for link, delay in zip(positions.T[::2], late, strict=True):
        link[:] = later(link, -delay / recording.sample_time)
    return replace(recording, positions=positions)


Doubt = Callable[[Doubted], FloatArray]


def calibration(doubted: Doubted) -> FloatArray:
    """No sensor's scale is known better."""
    return CALIBRATION * np.diag(doubted.values)


def noise_of_the_inputs(doubted: Doubted) -> FloatArray:
    """Noise of the logged torque makes its effect look smaller: twice as much does so twice.

    Noise of both signs is added, so that the mean change is the bias alone (simulation and
    extrapolation: Cook and Stefanski, J. American Statistical Association 89, 1994).
    """
    job, fitted = doubted.job, doubted.fitted
    rng = np.random.default_rng(_SEED)
    samples = job.data.samples
    drawn = [doubted.input_noise * rng.standard_normal(r.inputs.shape) for r in samples]
    moved = -doubted.values
    for sign in (1.0, -1.0):
        noisy = tuple(
            replace(r, inputs=r.inputs + sign * noise)
            for r, noise in zip(samples, drawn, strict=True)
        )
        other = replace(job, data=replace(job.data, samples=noisy)).in_band
        moved = moved + 0.5 * other.with_gains_of(fitted, fitted.by_name, NEAR_STEPS).values
    return moved[:, None]


def halves_of_the_log(doubted: Doubted) -> FloatArray:
    """What is not random differs between the halves of the log, fitted with its gains."""
    fitted, found = doubted.fitted, []
    for data in doubted.job.data.halves():
        in_band = replace(doubted.job, data=data).in_band
        half = in_band.with_gains_of(fitted, fitted.by_name, NEAR_STEPS)
        found.append(Repeat(half.values, half.unit_deviations**2))
    return between_halves(*found)


def another_band(doubted: Doubted) -> FloatArray:
    """What is not random differs between bands."""
    best, job = doubted.disturbed.best, replace(doubted.job, factor=2 * doubted.job.factor)
    other = DisturbedFit(job, job.in_band.fit(best.fitted.by_name, best.sizes, best.fitted), ())
    own, narrower = (
        Repeat(each.fitted.values, np.diag(each.estimate.covariance))
        for each in (doubted.disturbed, other)
    )
    return between_bands(own, [narrower])


def other_minima(doubted: Doubted) -> FloatArray:
    """Another minimum that is hardly less likely may be the right one."""
    best, rivals = doubted.disturbed.best, doubted.disturbed.rivals
    near = [r.fitted for r in rivals if r.cost < best.cost + RIVAL]
    moved = [rival.values - doubted.values for rival in near]
    return np.column_stack(moved) if moved else np.zeros((len(doubted.values), 0))


def unfinished_steps(doubted: Doubted) -> FloatArray:
    """Where steps do not end, as dry friction makes them rough, the next one is still to come."""
    return doubted.fitted.minimum.reduced.values_step[:, None]


def negative_values(doubted: Doubted) -> FloatArray:
    """A friction that drives has the part of something else: it may be zero as well."""
    covariance = doubted.estimate.covariance
    found = []
    for place, name in enumerate(doubted.fitted.names):
        variance, value = covariance[place, place], doubted.values[place]
        least = -THRESHOLDS.friction_sign * np.sqrt(variance)
        positive = any(word in name for word in _NEVER_NEGATIVE)
        if positive and 0.0 < variance < np.inf and value < least:
            found.append(-value / variance * covariance[:, place])
    return np.array(found).T if found else np.zeros((len(doubted.values), 0))


def looks_like_a_term(doubted: Doubted) -> FloatArray:
    """What a balance leaves unexplained may look like any one of its terms in part.

    What passes for noise of an input does not.
    """
    job = doubted.job
    torques = doubted.disturbed.disturbing_torques()
    noise = np.minimum(doubted.input_noise / np.maximum(doubted.white_noise, 1e-300), 1.0)
    shares = np.array([*doubted.disturbed.shares().values()])
    for each in (torques, shares):
        each[1::2] *= np.sqrt(1.0 - noise**2)
    sizes = effect_sizes(job.balance, job.data.samples)
    deviations = {}
    for place, (name, _, term) in enumerate(job.balance.placed()):
        seen = sizes[:, place] > 0.0
        friction = isinstance(term, JointTerm) and "v" in term.expression
        part = np.array([like_a_term(share, friction=friction) for share in shares])
        if seen.any():  # where it stands in two balances, the better one tells
            deviations[name] = float(((part * torques)[seen] / sizes[seen, place]).min())
    return np.diag([deviations.get(name, 0.0) for name in doubted.fitted.names])


def play(doubted: Doubted) -> FloatArray:
    """A spring with play looks like one that hardens, and softer than it is."""
    job = doubted.job
    changes = changes_by_play(job.balance, doubted.disturbed.values, doubted.timely)
    names = doubted.fitted.names
    return np.array([[change.get(name, 0.0) for change in changes] for name in names])


DOUBTS: tuple[tuple[Doubt, str], ...] = (
    (calibration, ""),
    (
        noise_of_the_inputs,
        "noise of the logged torque: excite harder, or log it finer",
    ),
    (halves_of_the_log, "the halves of the log disagree"),
    (another_band, "it depends on the band of the log that is fitted"),
    (other_minima, "another set of values explains the log as well"),
    (unfinished_steps, "the steps of the fit do not end"),
    (negative_values, "a friction or damping came out negative"),
    (play, "its spring looks like one with play"),
    (looks_like_a_term, "what no term describes may look like it"),
)
"""Each doubt, and what is said where it makes most of an interval."""


def with_doubts(disturbed: DisturbedFit) -> tuple[Estimate, dict[str, str]]:
    """The estimate with all doubts in its covariance, and which made most of each variance."""
    doubted = Doubted(disturbed)
    with ThreadPoolExecutor(cores()) as pool:
        found = [*pool.map(lambda each: _directions(each[0], doubted), DOUBTS)]
    estimate = doubted.estimate
    for directions in found:
        estimate = estimate.widened(directions @ directions.T)
    said = [""] * len(estimate.names)
    for directions, (_, words) in zip(found, DOUBTS, strict=True):
        variances = np.sum(directions**2, axis=1)
        said = [
            words if 0.5 * whole < variance < np.inf else before
            for variance, whole, before in zip(
                variances, np.diag(estimate.covariance), said, strict=True
            )
        ]
    return estimate, dict(zip(estimate.names, said, strict=True))


def _directions(doubt: Doubt, doubted: Doubted) -> FloatArray:
    """What a doubt says; nothing where its own fit fails."""
    try:
        return doubt(doubted)
    except ConvergenceError:
        return np.zeros((len(doubted.values), 0))
