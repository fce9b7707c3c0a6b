"""The fit of an arm that its model does not explain: with a disturbance in each balance.

As for one joint (`flexid.identification.estimation.disturbed`), but all balances at once, and with
dry friction that follows from the motion and sticks. Of stiff joints there are several minima,
most of them at values that no arm has: see `as_physical`.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from flexid.arms.fitting import ArmFit, noise_of, with_covariance
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.balance_motion import balance_columns, balance_motion, balance_unknowns
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.estimators.gauss_newton import Minimum, minimise
from flexid.estimators.innovations import Innovations, Sizes, fit_innovations
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.segments import divide
from flexid.identification.estimation.band import SPRING_SHARE, factor_of, thinned_samples
from flexid.models.torque_balance import TorqueBalance

_SUBSTEPS = 0.3  # of those of a fit without disturbances, which are exact to 1e-6 of the phase
_MOST_SUBSTEPS = 12  # per sample
_SEGMENT = 5.0  # s: long against what an observer remembers, and work for several cores
_FINE = 1e-2  # standard deviations that the last step is shorter than
_STEPS = 10  # with gains that are held
RIVAL = 30.0  # of twice the negative logarithm of the likelihood, by which another minimum is worse
_LIKELIER = 5.0  # the same, by which it is better, and its sizes are sought
_SAME = 0.1  # standard deviations, by which values of one minimum may differ
_DELAY_FALL = 25.0  # of twice the negative logarithm of the likelihood, that a delay brings


@dataclass(frozen=True, eq=False)
class Job:
    """What is fitted with disturbances."""

    balance: TorqueBalance
    recordings: Sequence[Samples]  # as they were logged
    fixed: Mapping[str, float]  # what is not sought
    slowest: float  # in 1/s, of a disturbance
    factor: int  # of so many samples one is fitted
    delayed: bool = False  # whether the inputs' delay is sought

    @classmethod
    def of(
        cls,
        balance: TorqueBalance,
        recordings: Sequence[Samples],
        fixed: Mapping[str, float],
        start: Mapping[str, float],
    ) -> "Job":
        """The job in the band of the fastest joint."""
        found = resonances(balance, {**fixed, **start})
        slowest = SPRING_SHARE * float(np.exp(np.mean(np.log(found))))
        sample_time = max(recording.sample_time for recording in recordings)
        factor = factor_of(float(found.max()), sample_time, min(map(len, recordings)))
        return cls(balance, recordings, fixed, slowest, factor)

    def thinned(self, recording: Samples) -> Samples:
        """A recording in the band."""
        return thinned_samples(recording, self.factor, held=True)

    def problem(self, start: Mapping[str, float]) -> tuple[SegmentedMotion, Point]:
        """The motion over recordings in the band, and where it begins."""
        own = [self.thinned(recording) for recording in self.recordings]
        segments = divide(own, _SEGMENT)
        hold = "zero" if self.factor == 1 else "cubic"
        timing = Timing(hold, {}, (INPUT,) if self.delayed else ())
        unknowns = balance_unknowns(self.balance, dict(self.fixed))
        problem = balance_motion(self.balance, segments, timing, unknowns)
        values = np.array([start.get(name, 0.0) for name in problem.names])
        point = Point(values, problem.start_states)
        problem = problem.at(point, 1.0 / noise_of(own))
        steps = int(np.ceil(_SUBSTEPS * problem.substeps))
        return replace(problem, substeps=min(steps, _MOST_SUBSTEPS)), point

    def fit(self, start: Mapping[str, float], sizes: Sizes | None = None) -> Innovations:
        """Values and sizes from a start, in turn; no data direct friction."""
        problem, point = self.problem(start)
        undirected = np.zeros((0, len(self.balance.rows)))
        return fit_innovations(problem, point, undirected, self.slowest, sizes)

    def with_gains_of(self, found: Innovations, start: Mapping[str, float]) -> Minimum:
        """Values alone, with the observer of another fit."""
        problem, point = self.problem(start)
        problem = replace(problem, observer=found.problem.observer, weights=found.problem.weights)
        return minimise(problem, point, _FINE, insist=False, iterations=_STEPS)


@dataclass(frozen=True, eq=False)
class DisturbedFit:
    """The likeliest fit of an arm with disturbances."""

    job: Job
    found: Innovations
    rivals: tuple[Innovations, ...]  # where other starts led

    @property
    def values(self) -> dict[str, float]:
        """All parameters by name, with those that were not sought."""
        return {**self.job.fixed, **values_of(self.found)}

    @property
    def fit(self) -> ArmFit:
        """The same as fits of an arm are reported; no value better known than by white noise."""
        own = [self.job.thinned(recording) for recording in self.job.recordings]
        made = with_covariance(self.found.problem, self.found.minimum, noise_of(own))
        least, now = np.diag(self.found.minimum.reduced.inverse), np.diag(made.covariance)
        grown = np.sqrt(np.maximum(np.divide(least, now, out=np.ones_like(now), where=now > 0), 1))
        return replace(made, covariance=made.covariance * np.outer(grown, grown))

    def disturbing_torques(self) -> FloatArray:
        """Root mean square torque in each balance that no term describes."""
        rows = len(self.job.balance.rows)
        signals = np.zeros((1 + rows, rows, 3))
        signals[1:, :, 2] = np.eye(rows)
        inputs = np.zeros((1 + rows, self.job.balance.joints))
        pi = np.array([self.values[name] for name in self.job.balance.coefficients])
        torques = balance_columns(self.job.balance, signals, inputs) @ pi
        return np.abs(np.diag(torques[1:] - torques[0])) * self.found.sizes.disturbances

    def shares(self) -> dict[str, float]:
        """What each balance leaves unexplained over its acceleration, root mean squares."""
        squares, count = np.zeros(len(self.job.balance.rows)), 0
        for samples in (
            thinned_samples(r, 2 * self.job.factor, held=True) for r in self.job.recordings
        ):
            rates = np.diff(samples.positions, 2, axis=0) / samples.sample_time**2
            squares, count = squares + np.sum(rates**2, axis=0), count + len(rates)
        accelerations = np.sqrt(np.maximum(squares / count, np.finfo(float).tiny))
        shares = np.minimum(self.found.sizes.disturbances / accelerations, 1.0)
        names = (row.name for row in self.job.balance.rows)
        return dict(zip(names, shares.tolist(), strict=True))


def fit_disturbed(
    balance: TorqueBalance,
    recordings: Sequence[Samples],
    fixed: Mapping[str, float],
    starts: Sequence[Mapping[str, float]],
) -> DisturbedFit:
    """The likeliest of the fits from some starts, with a delay of the inputs if there is one."""
    job = Job.of(balance, recordings, fixed, starts[0])
    ends: list[Innovations] = []

    for start in starts:
        with suppress(ConvergenceError):
            _go_on(job, as_physical(balance, start), ends)
    if ends:
        with suppress(ConvergenceError):
            _go_on(job, as_physical(balance, values_of(ends[0])), ends)
    if not ends:
        raise ConvergenceError(
            "arm",
            "the model cannot follow the log with disturbances either: check the signs and units "
            "of the torques and angles, the order of the joints, and the lengths",
        )
    best, *rivals = ends
    late = replace(job, delayed=True)
    start = values_of(best)
    with suppress(ConvergenceError):
        fall = best.minimum.equations.cost - late.with_gains_of(best, start).equations.cost
        if fall > _DELAY_FALL:
            later = late.fit(start, best.sizes)
            if later.cost < best.cost - _DELAY_FALL:
                return DisturbedFit(late, later, ())
    return DisturbedFit(job, best, tuple(rivals))


def _go_on(job: Job, start: Mapping[str, float], ends: list[Innovations]) -> None:
    """Add the end that a start leads to, if it may be as likely as the best so far.

    Sizes are sought once more only where the values are likelier with those of the best.
    """
    sizes = None
    if ends:
        best = ends[0]
        near = job.with_gains_of(best, start)
        more = near.equations.cost - best.minimum.equations.cost
        if more > RIVAL or _is_same(near, best):
            return
        if more > -_LIKELIER:
            ends.append(replace(best, minimum=near, cost=best.cost + more))
            return
        start = dict(zip(best.problem.names, near.point.values.tolist(), strict=True))
        sizes = best.sizes
    found = job.fit(start, sizes)
    if np.isfinite(found.cost):
        ends.append(found)
        ends.sort(key=lambda end: end.cost)


def _is_same(near: Minimum, best: Innovations) -> bool:
    """Whether a start led to the minimum that is known already."""
    spread = np.sqrt(np.diag(best.minimum.reduced.inverse))
    moved = np.abs(near.point.values - best.minimum.point.values)
    return bool((moved <= _SAME * spread).all())


def as_physical(balance: TorqueBalance, start: Mapping[str, float]) -> dict[str, float]:
    """A start of about the same motion in which no friction drives and no rotor couples backwards.

    Of a joint that is stiff, motor and link show their sum alone: friction may stand at either, and
    inertia may move from the link to the motor, if the coupling of the rotor makes up for it.
    """
    moved = dict(start)
    for joint in range(1, balance.joints + 1):
        for law in ("viscous", "coulomb"):
            link, motor = (f"{side}_{law}_friction_{joint}" for side in ("link", "motor"))
            moved[motor] = max(moved[motor] + moved[link], 0.0)
            moved[link] = 0.0
        moved[f"joint_damping_{joint}"] = max(moved[f"joint_damping_{joint}"], 0.0)
        coupling = f"rotor_coupling_{joint}"
        more = -min(moved.get(coupling, 0.0), 0.0)
        if more > 0.0:
            moved[coupling] = 0.0
            moved[f"motor_inertia_{joint}"] += more
            moved[f"link_inertia_{joint}"] -= more
            moved[f"link_inertia_{joint - 1}"] += more
    return moved


def values_of(found: Innovations) -> dict[str, float]:
    """What was sought, by name."""
    return dict(zip(found.problem.names, found.minimum.point.values.tolist(), strict=True))


def resonances(balance: TorqueBalance, values: Mapping[str, float]) -> FloatArray:
    """Angular frequency in rad/s of each joint's motor against its own link."""
    least = np.finfo(float).tiny
    found = []
    for joint in range(1, balance.joints + 1):
        names = (f"{name}_{joint}" for name in ("joint_stiffness", "motor_inertia", "link_inertia"))
        stiffness, motor, link = (max(abs(values[name]), least) for name in names)
        found.append(np.sqrt(stiffness * (1.0 / motor + 1.0 / link)))
    return np.array(found)
