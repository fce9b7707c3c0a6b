"""The fit of an arm: from least squares over short segments to long ones."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.balance_motion import balance_motion, balance_unknowns
from flexid.estimators.balance_start import filtered, starts
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.estimators.cluster_covariance import cluster_influences
from flexid.estimators.gauss_newton import Minimum, minimise
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.segments import Segments, divide
from flexid.estimators.shrunken_covariance import shrunken
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.torque_balance import TorqueBalance
from flexid.recording.velocities import position_noise

SHORTEST = 0.1
"""Length in s of the segments that a fit begins with."""

LONGEST = 10.0
"""Length in s of the longest segments, if the log has room for two of them."""

_ROUGH, _FINE = 0.1, 1e-3  # standard deviations that the last step is shorter than
_TRIAL_STEPS = 3  # of each start
_TRIAL_SEGMENTS = 40  # over which starts are compared
_STEPS = 8  # over the first segments, and over those that count
_STEPS_BETWEEN = 5  # over the others
_MOST_SUBSTEPS = 30  # per sample: a model that is faster is not yet the right one
_ROUGHLY = 8  # of these, of a fit that another one follows
_USUAL = 1.7  # s: segments that a fit goes up to in any case
_GROWTH = 1.01  # of the residuals' variance with the segments' length, up to which it goes on
_UNFINISHED = 1.0  # standard deviations, of the step that would come next
_TIMED_FROM = 0.35  # s: length of segments from which on the inputs' timing shows
_TIMINGS = (Timing("zero"), Timing("zero", {}, (INPUT,)), Timing("linear", {}, (INPUT,)))
_EFFECT_BAND = 20.0  # Hz up to which a parameter's torque is taken
_TIMING_FALL = 25.0  # of the weighted squares, over their variance, that an unusual timing brings
_TIMING_SHARE = 0.1  # of the weighted squares, that it brings where the model explains little
_UNEXPLAINED = 1.5  # variance of the residuals over the encoders', that no exact fit mends
_PROMISING = 1.2  # the same, up to which no better start is looked for


Solved = tuple[SegmentedMotion, Minimum]


@dataclass(frozen=True, eq=False)
class ArmFit:
    """A fit over segments of one length."""

    problem: SegmentedMotion  # what was fitted
    minimum: Minimum  # where it ended
    covariance: FloatArray  # (k, k): of what was sought
    degrees_of_freedom: FloatArray  # (k,): of each variance; 0 where the log says nothing
    noise: FloatArray  # (n_rows,): standard deviation of each encoder's noise

    @property
    def values(self) -> dict[str, float]:
        """What was sought, by name."""
        return _by_name(self.problem, self.minimum)

    @property
    def excess(self) -> FloatArray:
        """Residual of each encoder over its noise, root mean squares."""
        segments, residuals = self.problem.segments, self.minimum.equations.residuals
        return np.sqrt(np.mean(residuals[segments.within] ** 2, axis=0)) / self.noise

    @property
    def ended(self) -> bool:
        """Whether there is a minimum, and something known of it."""
        return _has_ended(self.minimum)

    @property
    def explains(self) -> bool:
        """Whether it leaves hardly more than the encoders' noise."""
        return self.ended and float(np.mean(self.excess**2)) <= THRESHOLDS.sensor_excess

    @property
    def duration(self) -> float:
        """Mean length of a segment in s."""
        return _duration(self.problem.segments)


@dataclass(frozen=True, eq=False)
class ExactFits:
    """Fits without disturbances over segments of growing length, as far as they are of use."""

    found: tuple[Solved, ...]
    noise: FloatArray  # (n_rows,): standard deviation of each encoder's noise

    @property
    def hopeless(self) -> str:
        """Why there is no fit without disturbances; empty where there may be one."""
        return _hopeless(self.found[-1])

    @property
    def starts(self) -> tuple[dict[str, float], ...]:
        """Values over the shortest segments and over the longest, by name."""
        ends = (self.found[0], self.found[-1])[: len(self.found)]
        return tuple(_by_name(problem, minimum) for problem, minimum in ends)

    def best(self) -> ArmFit:
        """The fit over the longest segments that can be trusted, with its covariance."""
        ends = _ends(self.found, self.noise)
        best = next(ends, None)
        if best is None:  # the last one is shown for what it is: its intervals are infinite
            return with_covariance(*self.found[-1], self.noise)
        shorter = next(ends, None) if best.explains else None
        return best if shorter is None else _spread(best, shorter)


def exact_fits(
    balance: TorqueBalance,
    recordings: Sequence[Samples],
    fixed: Mapping[str, float],
    progress: Callable[[str], None],
) -> ExactFits:
    """Fit a torque balance to recordings, until its residuals say that it lacks something."""
    divisions = _divisions(recordings)
    noise = noise_of(recordings)
    progress("least squares")
    found = [begun(balance, recordings, dict(fixed), divisions[0], noise)]
    timed = False
    for segments in divisions[1:]:
        duration = _duration(segments)
        progress(f"segments of {duration:.2g} s")
        try:
            longer = _over_longer(found[-1], segments, noise)
        except ConvergenceError:
            break
        if not timed and (duration >= _TIMED_FROM or not _near_noise(longer)):
            longer, timed = _timed(longer, noise), True
        found.append(longer)
        if _hopeless(longer) or (duration > _USUAL and not _holds(longer, found)):
            break
    return ExactFits(tuple(found), noise)


def _by_name(problem: SegmentedMotion, minimum: Minimum) -> dict[str, float]:
    return dict(zip(problem.names, minimum.point.values.tolist(), strict=True))


def _has_ended(minimum: Minimum) -> bool:
    """Whether steps ended, and not because sensitivities beyond all bounds left nothing known."""
    return minimum.last_step <= _UNFINISHED and not minimum.reduced.free.all()


def _hopeless(one: Solved) -> str:
    """Why no exact fit over longer segments will do; empty where one may."""
    problem, minimum = one
    duration = _duration(problem.segments)
    if duration > _USUAL:
        return ""
    if not _near_noise(one):
        return f"residuals exceed the encoders' noise within {duration:.2g} s"
    if duration >= _TIMED_FROM and minimum.last_step > _UNFINISHED:
        return f"steps do not end over segments of {duration:.2g} s"
    return ""


def _near_noise(one: Solved) -> bool:
    problem, minimum = one
    return minimum.variance(problem) <= _UNEXPLAINED


def _timed(found: Solved, noise: FloatArray) -> Solved:
    """The same fit, unless another timing of the inputs is clearly better."""
    best = found
    for timing in _TIMINGS[1:]:
        try:
            other = _retimed(found, timing, noise)
        except ConvergenceError:
            continue
        if other is not None and _falls(best, other[1].equations.cost):
            best = other
    return best


def _retimed(found: Solved, timing: Timing, noise: FloatArray) -> Solved | None:
    """The fit with another timing; None where the first step from the old one promises little."""
    problem, minimum = found
    other = replace(problem, timing=timing)
    late = [0.0] * (len(other.names) - len(problem.names))
    point = Point(np.append(minimum.point.values, late), minimum.point.initial_states)
    equations = other.equations(point)
    # A fit that has not ended would go on with the old timing as well.
    promised = equations.cost - other.solve(equations).decrement + minimum.reduced.decrement
    if not _falls(found, promised):
        return None
    return _roughly(other, point, noise)


def _falls(before: Solved, cost: float) -> bool:
    """Whether weighted squares fall enough for an unusual timing."""
    problem, minimum = before
    least = _TIMING_FALL * minimum.variance(problem)
    if not _near_noise(before):
        least = max(least, _TIMING_SHARE * minimum.equations.cost)
    return cost < minimum.equations.cost - least


def _ends(found: Sequence[Solved], noise: FloatArray) -> Iterator[ArmFit]:
    """The fit over the longest segments that can be trusted, and those before it.

    Long segments say more of what is slow, if the model is right. Where it is not, residuals grow
    with the length, and what the model lacks biases the values.
    """
    for problem, minimum in reversed(found):
        if _duration(problem.segments) > _USUAL and not _holds((problem, minimum), found):
            continue
        with suppress(ConvergenceError):
            own = _reweighted(problem, minimum)
            end = minimise(own, minimum.point, _FINE, insist=False, iterations=_STEPS)
            if _has_ended(end):
                yield with_covariance(own, end, noise)


def _holds(one: Solved, found: Sequence[Solved]) -> bool:
    """Whether the residuals are hardly larger than those of the shortest segments that fit."""
    problem, minimum = next(filter(_near_noise, found), found[0])
    return one[1].variance(one[0]) <= _GROWTH * minimum.variance(problem)


def _reweighted(problem: SegmentedMotion, minimum: Minimum) -> SegmentedMotion:
    """The same with each output's weight from what it leaves over, and steps that suit."""
    noise = np.maximum(minimum.noise(problem), 0.3 / problem.weights)
    return at_point(problem, minimum.point, noise)


def _duration(segments: Segments) -> float:
    return float(np.mean(segments.lengths * segments.sample_times))


def _divisions(recordings: Sequence[Samples]) -> list[Segments]:
    """The recordings cut into segments of growing length, each of two of the length before."""
    shortest = min(len(recording) * recording.sample_time for recording in recordings)
    divisions = [divide(recordings, min(LONGEST, 0.5 * shortest))]
    while divisions[-1].can_be_halved:
        if _duration(divisions[-1]) < 1.5 * SHORTEST:
            break
        divisions.append(divisions[-1].halved())
    return divisions[::-1]


def noise_of(recordings: Sequence[Samples]) -> FloatArray:
    """Standard deviation of each position's noise."""
    noise = np.array([[position_noise(c) for c in r.positions.T] for r in recordings]).max(axis=0)
    largest = max(float(np.abs(r.positions).max()) for r in recordings)
    return np.maximum(noise, 1e-9 * largest)


def begun(
    balance: TorqueBalance,
    recordings: Sequence[Samples],
    fixed: dict[str, float],
    segments: Segments,
    noise: FloatArray,
) -> Solved:
    """The start that gets closest to the log within a few steps, and where these lead."""
    unknowns = balance_unknowns(balance, fixed)
    problem = balance_motion(balance, segments, Timing("zero"), unknowns)
    few = replace(problem, segments=segments.some(_TRIAL_SEGMENTS))
    tried: list[Minimum] = []
    for start in starts(balance, recordings, fixed):
        point = Point(np.array([start[name] for name in problem.names]), few.start_states)
        with suppress(ConvergenceError):
            own, found = _roughly(few, point, noise, _TRIAL_STEPS)
            tried.append(found)
            if found.variance(own) <= _PROMISING:
                break
    for found in sorted(tried, key=lambda one: one.equations.cost):
        point = Point(found.point.values, problem.start_states)
        with suppress(ConvergenceError):
            return _roughly(problem, point, noise)
    raise ConvergenceError(
        "arm",
        "the model cannot follow the log from any start: check the signs and units of the "
        "torques and angles, the order of the joints, and the lengths",
    )


def at_point(
    problem: SegmentedMotion, point: Point, noise: FloatArray, most: int = _MOST_SUBSTEPS
) -> SegmentedMotion:
    """The problem with the encoders' weights, and with steps that suit the motion at a point."""
    own = problem.at(point, 1.0 / noise)
    return replace(own, substeps=min(own.substeps, most))


def _roughly(
    problem: SegmentedMotion, point: Point, noise: FloatArray, iterations: int = _STEPS
) -> Solved:
    """A minimum near a point, with steps that may be too long for a stiff joint."""
    own = at_point(problem, point, noise, _ROUGHLY)
    return own, minimise(own, point, _ROUGH, insist=False, iterations=iterations)


def _over_longer(before: Solved, segments: Segments, noise: FloatArray) -> Solved:
    """Go on over longer segments."""
    problem, minimum = before
    states = minimum.point.initial_states[:: len(problem.segments) // len(segments)]
    longer = replace(problem, segments=segments)
    return _roughly(longer, Point(minimum.point.values, states), noise, _STEPS_BETWEEN)


def _spread(best: ArmFit, other: ArmFit) -> ArmFit:
    """A fit whose covariance holds what another length of the segments makes of the log."""
    if other.problem.names != best.problem.names:
        return best
    apart = other.minimum.point.values - best.minimum.point.values
    return replace(best, covariance=best.covariance + 0.5 * np.outer(apart, apart))


def with_covariance(problem: SegmentedMotion, minimum: Minimum, noise: FloatArray) -> ArmFit:
    """The covariance from the scores of the blocks, drawn towards that of white noise."""
    reduced = minimum.reduced
    variance = minimum.variance(problem)
    influences, freedom = cluster_influences(problem.clusters(minimum.equations, reduced))
    freedom = np.where(reduced.free, 0.0, freedom)
    covariance, freedom = shrunken(
        influences @ influences.T, reduced.inverse * max(variance, 1e-300), freedom
    )
    return ArmFit(problem, minimum, covariance, freedom, noise)


def effect_sizes(balance: TorqueBalance, recordings: Sequence[Samples]) -> FloatArray:
    """Root mean square torque of one unit of each parameter in each balance.

    Returns shape (n_rows, n_parameters).
    """
    rate = 0.1 / max(recording.sample_time for recording in recordings)
    columns = filtered(balance, recordings, min(_EFFECT_BAND, rate)).columns
    return np.sqrt(np.mean(columns**2, axis=0))
