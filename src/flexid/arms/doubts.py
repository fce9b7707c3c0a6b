"""What may be wrong with the fit of a disturbed arm that its likelihood does not show.

Each doubt says by how much the values may be off, as directions of errors, shape (k, m), like those
of one joint in `flexid.identification.estimation.doubts`. Most change the log, and look where the
fit goes.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexid.arms.disturbed import RIVAL, DisturbedFit, Job, values_of
from flexid.arms.fitting import ArmFit, effect_sizes
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.threads import cores
from flexid.identification.estimation.disturbed import beyond_chance, half_of
from flexid.identification.estimation.doubts import (
    CALIBRATION,
    LIKE_A_FRICTION,
    LIKE_A_TERM,
)
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.torque_balance import JointTerm
from flexid.recording.velocities import position_noise

_SEED = 1  # of the noise that is added to inputs
_NEVER_NEGATIVE = ("friction", "damping", "coupling")  # but as a sign of something else


@dataclass(frozen=True, eq=False)
class Doubted:
    """A fit, and what the doubts look at."""

    disturbed: DisturbedFit
    fit: ArmFit  # the same, with its covariance

    @property
    def job(self) -> Job:
        """What was fitted."""
        return self.disturbed.job

    @cached_property
    def values(self) -> FloatArray:
        """What was sought, shape (k,)."""
        return self.fit.minimum.point.values

    @property
    def variances(self) -> FloatArray:
        """Of these, shape (k,)."""
        return np.diag(self.fit.covariance)

    def again(self, job: Job) -> tuple[FloatArray, FloatArray] | None:
        """Values and variances of a fit to another log; None where it fails."""
        found = self.disturbed.found
        try:
            other = job.fit(values_of(found), found.sizes)
        except ConvergenceError:
            return None
        own = DisturbedFit(job, other, ()).fit
        return own.minimum.point.values, np.diag(own.covariance)

    @cached_property
    def white_noise(self) -> FloatArray:
        """Noise of each input that its motor's disturbance would be, shape (n_joints,)."""
        sizes, values = self.disturbed.found.sizes, self.disturbed.values
        sample_time = max(recording.sample_time for recording in self.job.recordings)
        joints = range(1, self.job.balance.joints + 1)
        gains = np.array([abs(values[f"torque_constant_{joint}"]) for joint in joints])
        torques = self.disturbed.disturbing_torques()[1::2]
        spectra = 2.0 / (sizes.rates[1::2] * sample_time)  # over that of white noise of that size
        return torques * np.sqrt(spectra) / np.maximum(gains, 1e-12)

    @cached_property
    def input_noise(self) -> FloatArray:
        """Noise of each input that may be in the log alone, shape (n_joints,)."""
        logged = [[position_noise(c) for c in r.inputs.T] for r in self.job.recordings]
        return np.minimum(np.max(logged, axis=0), self.white_noise)


Doubt = Callable[[Doubted], FloatArray]


def calibration(doubted: Doubted) -> FloatArray:
    """No sensor's scale is known better."""
    return CALIBRATION * np.diag(doubted.values)


def noise_of_the_inputs(doubted: Doubted) -> FloatArray:
    """Noise of the logged torque makes its effect look smaller: twice as much does so twice.

    Noise of both signs is added, so that the mean change is the bias alone (simulation and
    extrapolation: Cook and Stefanski, J. American Statistical Association 89, 1994).
    """
    job, rng = doubted.job, np.random.default_rng(_SEED)
    found = doubted.disturbed.found
    drawn = [doubted.input_noise * rng.standard_normal(r.inputs.shape) for r in job.recordings]
    moved = -doubted.values
    for sign in (1.0, -1.0):
        noisy = [
            replace(r, inputs=r.inputs + sign * noise)
            for r, noise in zip(job.recordings, drawn, strict=True)
        ]
        with_noise = replace(job, recordings=noisy).with_gains_of(found, values_of(found))
        moved = moved + 0.5 * with_noise.point.values
    return moved[:, None]


def halves_of_the_log(doubted: Doubted) -> FloatArray:
    """What is not random differs between the halves of the log."""
    job = doubted.job
    ends = []
    for second in (False, True):
        halves = replace(job, recordings=[half_of(r, second=second) for r in job.recordings])
        found = halves.with_gains_of(doubted.disturbed.found, values_of(doubted.disturbed.found))
        ends.append((found.point.values, np.diag(found.reduced.inverse)))
    (a, of_a), (b, of_b) = ends
    return beyond_chance(0.5 * (a - b), 0.25 * (of_a + of_b))[:, None]


def another_band(doubted: Doubted) -> FloatArray:
    """What is not random differs between bands."""
    other = doubted.again(replace(doubted.job, factor=2 * doubted.job.factor))
    if other is None:
        return np.zeros((len(doubted.values), 0))
    values, variances = other
    by_chance = np.abs(variances - doubted.variances)
    return beyond_chance(values - doubted.values, by_chance)[:, None]


def other_minima(doubted: Doubted) -> FloatArray:
    """Another minimum that is hardly less likely may be the right one."""
    found, rivals = doubted.disturbed.found, doubted.disturbed.rivals
    near = [
        r for r in rivals if r.cost < found.cost + RIVAL and r.problem.names == found.problem.names
    ]
    moved = [rival.minimum.point.values - doubted.values for rival in near]
    return (
        np.array(moved).reshape(len(moved), -1).T if moved else np.zeros((len(doubted.values), 0))
    )


def negative_values(doubted: Doubted) -> FloatArray:
    """A friction that drives has the part of something else: it may be zero as well."""
    covariance = doubted.fit.covariance
    found = []
    for place, name in enumerate(doubted.fit.problem.names):
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
    sizes = effect_sizes(job.balance, job.recordings)
    deviations = {}
    for place, (name, _, term) in enumerate(job.balance.placed()):
        seen = sizes[:, place] > 0.0
        friction = isinstance(term, JointTerm) and "v" in term.expression
        part = np.full(len(shares), LIKE_A_FRICTION) if friction else LIKE_A_TERM * shares
        if seen.any():  # where it stands in two balances, the better one tells
            deviations[name] = float(((part * torques)[seen] / sizes[seen, place]).min())
    return np.diag([deviations.get(name, 0.0) for name in doubted.fit.problem.names])


DOUBTS: tuple[tuple[Doubt, str], ...] = (
    (calibration, ""),
    (
        noise_of_the_inputs,
        "noise of the logged torque: excite harder, or log it finer",
    ),
    (halves_of_the_log, "the halves of the log disagree"),
    (another_band, "it depends on the band of the log that is fitted"),
    (other_minima, "another set of values explains the log as well"),
    (negative_values, "a friction or damping came out negative"),
    (looks_like_a_term, "what no term describes may look like it"),
)
"""Each doubt, and what is said where it makes most of an interval."""


def with_doubts(disturbed: DisturbedFit) -> tuple[ArmFit, dict[str, str]]:
    """The fit with all doubts in its covariance, and which made most of each value's variance."""
    doubted = Doubted(disturbed, disturbed.fit)
    with ThreadPoolExecutor(cores()) as pool:
        found = [*pool.map(lambda each: _directions(each[0], doubted), DOUBTS)]
    covariance = doubted.fit.covariance + sum(own @ own.T for own in found)
    said = [""] * len(covariance)
    for directions, (_, words) in zip(found, DOUBTS, strict=True):
        variances = np.sum(directions**2, axis=1)
        said = [
            words if 0.5 * whole < variance < np.inf else before
            for variance, whole, before in zip(variances, np.diag(covariance), said, strict=True)
        ]
    names = doubted.fit.problem.names
    return replace(doubted.fit, covariance=covariance), dict(zip(names, said, strict=True))


def _directions(doubt: Doubt, doubted: Doubted) -> FloatArray:
    """What a doubt says; nothing where its own fit fails."""
    try:
        return doubt(doubted)
    except ConvergenceError:
        return np.zeros((len(doubted.values), 0))
