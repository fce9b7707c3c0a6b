"""The fit of an arm: from least squares over short segments to long ones."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

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
from flexid.models.torque_balance import TorqueBalance
from flexid.recording.velocities import position_noise

SHORTEST = 0.1
"""Length in s of the segments that a fit begins with."""

LONGEST = 10.0
"""Length in s of the longest segments, if the log has room for two of them."""

_ROUGH, _FINE = 0.1, 1e-3  # standard deviations that the last step is shorter than
_TRIAL_STEPS = 3  # of each start
_TRIAL_SEGMENTS = 40  # over which starts are compared
_STEPS = 8  # over segments that are not the last
_MOST_SUBSTEPS = 30  # per sample: a model that is faster is not yet the right one
_USUAL = 1.7  # s: segments that a fit goes up to in any case
_GROWTH = 1.01  # of the residuals' variance with the segments' length, up to which it goes on
_UNFINISHED = 1.0  # standard deviations, of the step that would come next
_COMPARED = 2  # lengths of segments whose fits are compared
_TIMED_FROM = 0.35  # s: length of segments from which on the inputs' timing shows
_TIMINGS = (Timing("zero"), Timing("zero", {}, (INPUT,)), Timing("linear", {}, (INPUT,)))
_EFFECT_BAND = 20.0  # Hz up to which a parameter's torque is taken
_TIMING_FALL = 25.0  # of the weighted squares, over their variance, that an unusual timing brings


@dataclass(frozen=True, eq=False)
class ArmFit:
    """A fit over segments of one length."""

    problem: SegmentedMotion  # what was fitted
    minimum: Minimum  # where it ended
    covariance: FloatArray  # (k, k): of what was sought
    degrees_of_freedom: FloatArray  # (k,): of each variance; 0 where the log says nothing
    noise: FloatArray  # (n_rows,): standard deviation of each encoder's noise
    first: Mapping[str, float] = field(default_factory=dict)  # values over the shortest segments

    @property
    def values(self) -> dict[str, float]:
        """What was sought, by name."""
        return dict(zip(self.problem.names, self.minimum.point.values.tolist(), strict=True))

    @property
    def excess(self) -> FloatArray:
        """Residual of each encoder over its noise, root mean squares."""
        segments, residuals = self.problem.segments, self.minimum.equations.residuals
        return np.sqrt(np.mean(residuals[segments.within] ** 2, axis=0)) / self.noise

    @property
    def ended(self) -> bool:
        """Whether there is a minimum, and something known of it."""
        minimum = self.minimum
        return minimum.last_step <= _UNFINISHED and not minimum.reduced.free.all()

    @property
    def duration(self) -> float:
        """Mean length of a segment in s."""
        return _duration(self.problem.segments)


def fit_arm(
    balance: TorqueBalance,
    recordings: Sequence[Samples],
    fixed: Mapping[str, float],
    progress: Callable[[str], None],
) -> ArmFit:
    """Fit a torque balance to recordings."""
    divisions = _divisions(recordings)
    noise = noise_of(recordings)
    progress("least squares")
    found = [begun(balance, recordings, dict(fixed), divisions[0], noise)]
    timings = _TIMINGS[:1]
    for segments in divisions[1:]:
        duration = _duration(segments)
        progress(f"segments of {duration:.2g} s")
        first_timed = len(timings) == 1 and duration >= _TIMED_FROM
        tried = []
        for timing in _TIMINGS if first_timed else timings[-1:]:
            try:
                tried.append(_over_longer(found[-1], segments, timing, noise))
            except ConvergenceError:
                continue
        if not tried:
            break
        found.append(_timed(tried))
        if duration > _USUAL and not _holds(found[-1], found[0]):
            break
        if first_timed:
            timings = (*timings, found[-1][0].timing)
    progress("intervals")
    last, *before = _ends(found, noise)
    problem, minimum = found[0]
    first = dict(zip(problem.names, minimum.point.values.tolist(), strict=True))
    return replace(_spread(last, before), first=first)


Solved = tuple[SegmentedMotion, Minimum]


def _timed(tried: Sequence[Solved]) -> Solved:
    """The first of several fits, unless another timing of the inputs is clearly better."""
    best = tried[0]
    for problem, minimum in tried[1:]:
        variance = minimum.variance(problem)
        if minimum.equations.cost < best[1].equations.cost - _TIMING_FALL * variance:
            best = problem, minimum
    return best


def _ends(found: Sequence[Solved], noise: FloatArray) -> list[ArmFit]:
    """The fit over the longest segments that can be trusted, and the one before it.

    Long segments say more of what is slow, if the model is right. Where it is not, residuals grow
    with the length, and what the model lacks biases the values.
    """
    ends: list[ArmFit] = []
    longest = [
        one for one in found if _duration(one[0].segments) <= _USUAL or _holds(one, found[0])
    ]
    for problem, minimum in reversed(longest):
        try:
            own = _reweighted(problem, minimum)
            end = minimise(own, minimum.point, _FINE, insist=False, iterations=_STEPS)
        except ConvergenceError:
            continue
        # Sensitivities that grew beyond all bounds leave nothing known, and no step to take.
        if end.last_step <= _UNFINISHED and not end.reduced.free.all():
            ends.append(with_covariance(own, end, noise))
        if len(ends) == _COMPARED:
            break
    # Where no fit ends, the last one is shown for what it is: its intervals are infinite.
    return ends or [with_covariance(*longest[-1], noise)]


def _holds(one: Solved, first: Solved) -> bool:
    """Whether the residuals are hardly larger than those of the shortest segments."""
    return one[1].variance(one[0]) <= _GROWTH * first[1].variance(first[0])


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
        own = at_point(few, point, noise)
        with suppress(ConvergenceError):
            tried.append(minimise(own, point, _ROUGH, insist=False, iterations=_TRIAL_STEPS))
    for found in sorted(tried, key=lambda one: one.equations.cost):
        point = Point(found.point.values, problem.start_states)
        own = at_point(problem, point, noise)
        with suppress(ConvergenceError):
            return own, minimise(own, point, _ROUGH, insist=False, iterations=_STEPS)
    raise ConvergenceError(
        "arm",
        "the model cannot follow the log from any start: check the signs and units of the "
        "torques and angles, the order of the joints, and the lengths",
    )


def at_point(problem: SegmentedMotion, point: Point, noise: FloatArray) -> SegmentedMotion:
    """The problem with the encoders' weights, and with steps that suit the motion at a point."""
    own = problem.at(point, 1.0 / noise)
    return replace(own, substeps=min(own.substeps, _MOST_SUBSTEPS))


def _over_longer(before: Solved, segments: Segments, timing: Timing, noise: FloatArray) -> Solved:
    """Go on over longer segments, with a timing of the inputs."""
    problem, minimum = before
    states = minimum.point.initial_states[:: len(problem.segments) // len(segments)]
    values = dict(zip(problem.names, minimum.point.values.tolist(), strict=True))
    longer = replace(problem, segments=segments, timing=timing)
    point = Point(np.array([values.get(name, 0.0) for name in longer.names]), states)
    longer = at_point(longer, point, noise)
    return longer, minimise(longer, point, _ROUGH, insist=False, iterations=_STEPS)


def _spread(best: ArmFit, ends: Sequence[ArmFit]) -> ArmFit:
    """A fit whose covariance holds what other lengths of the segments make of the log."""
    covariance = best.covariance.copy()
    for other in ends:
        if other is not best and other.problem.names == best.problem.names:
            apart = other.minimum.point.values - best.minimum.point.values
            covariance += 0.5 * np.outer(apart, apart)
    return replace(best, covariance=covariance)


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
