"""How a model of a log is fitted: from short segments to long ones.

Over short segments a fit finds its way from least squares; each longer length starts where the one
before it ended, with its states.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.normal_equations import least_with
from flexid.estimators.prediction_error import (
    ITERATIONS,
    MOST,
    NEARLY_NOISE,
    Minimum,
    minimise,
    refinement,
)
from flexid.estimators.samples import Segments, divide
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.unknowns import Unknowns, bounded_fit
from flexid.identification.full_model.model import FINE, ROUGH, Data, Fitted, M, Structure
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import POSITIVE

SHORTEST = 0.1
"""Length in s of the segments that a fit begins with: any start is good enough for these."""

LONGEST = 10.0
"""Length in s beyond which segments hold hardly more information."""

_CHANCE = 3.0  # standard deviations of a sum of squares
# Standard deviations. Where two slow sines seen by coarse encoders left three to seven, a minimum
# with a motor's inertia 40 % off explained the log as well.
_KNOWN = 20.0
_ENOUGH = 10_000  # samples, in which what explains most of a log shows


@dataclass(frozen=True)
class Steps:
    """How a fit takes its steps, and what ends them."""

    tolerance: float = ROUGH  # standard deviations, that the last step is shorter than
    insist: bool = True  # on convergence
    iterations: int = ITERATIONS  # at most
    enough: float = 0.0  # variance of the residuals, up to which convergence is not insisted on
    promised: float = np.inf  # the same that the first step has to promise
    least_gain: float = 0.0  # of the sum of squares, with less of which steps end
    coarser: float = 1.0  # steps of integration over the usual ones
    most_substeps: float = np.inf  # of these per sample

    def taken_by(self, problem: SegmentedMotion) -> SegmentedMotion:
        """A motion in steps of integration like that."""
        substeps = min(np.ceil(self.coarser * problem.substeps), self.most_substeps)
        return replace(problem, substeps=int(substeps))


USUAL = Steps()
"""Steps that insist on convergence, as short as the motion wants them."""

ON_THE_WAY = Steps(enough=NEARLY_NOISE)
"""Steps of a fit that only leads on."""

FIRST_STEPS = replace(ON_THE_WAY, iterations=8)
"""Steps of a fit from afar; those that halve the sum of squares are not counted."""

EXPLORING = replace(FIRST_STEPS, insist=False, least_gain=0.01)
"""Steps of a fit that shows whether a term is worth following up."""

_AT_ONCE = Steps(0.1, iterations=5, promised=NEARLY_NOISE)


def lengths(data: Data, longest: float = LONGEST, shortest: float = SHORTEST) -> list[Segments]:
    """The data cut into segments of growing length, each of two of the length before."""
    first = divide(data.samples, min(longest, data.duration), margin=data.margin)
    found = [first]
    while True:
        last = found[-1]
        if last.mean_duration < 1.5 * shortest or not last.can_be_halved:
            return found[::-1]
        found.append(last.halved())


def in_part(segments: Segments) -> Segments:
    """Some of very many segments, spread evenly: what leads nowhere there does so in no more."""
    count = max(1, int(_ENOUGH / segments.lengths.mean()))
    return segments if len(segments) < 2 * count else segments.some(count)


def fit_by_length(
    structure: Structure,
    data: Data,
    start: Mapping[str, float],
    divisions: Sequence[Segments],
    states: FloatArray | None = None,  # (n_segments, n_states)
    steps: Steps = ON_THE_WAY,
    leads_on: Callable[[Fitted], bool] = lambda _: True,
) -> list[Fitted]:
    """Fit over the first of some divisions, and over longer segments from there."""
    first = fit_segments(structure, data, divisions[0], start, states, steps)
    return [first, *longer_fits(first, divisions[1:], leads_on)]


def longer_fits(
    first: Fitted,
    divisions: Sequence[Segments],
    leads_on: Callable[[Fitted], bool] = lambda _: True,
) -> list[Fitted]:
    """Fits from one on, to those divisions whose segments are longer than its own.

    What explains the log over the longest at once is all that is needed. Otherwise each length
    begins where the one before it ended. They end at the length at which the fit fails, and with
    one that does not lead on. One whose steps do not end is kept where its residuals are nearly
    those of the noise.
    """
    longer = [each for each in divisions if len(each) < len(first.problem.segments)]
    if len(longer) > 1 and (whole := _explained_over(longer[-1], first)) is not None:
        return [whole]
    last, found = first, []
    for segments in longer:
        if not leads_on(last):
            break
        try:
            last = over_longer(last, segments, ON_THE_WAY)
        except ConvergenceError:
            break
        found.append(last)
    return found


def _explained_over(longest: Segments, short: Fitted) -> Fitted | None:
    """A fit over the longest segments from one over short ones, if it leaves no more than they do.

    Where these know inertias and stiffness, no other minimum explains the log as well, so that
    nothing is lost by the way there. Where they hardly do, several may.
    """
    if short.excess > THRESHOLDS.sensor_excess or not _is_known(short):
        return None
    with suppress(ConvergenceError):
        found = over_longer(short, longest, _AT_ONCE)
        floor = THRESHOLDS.noise_floor(short.excess)
        return found if beyond_noise(found, floor, short) <= 0.0 else None
    return None


def _is_known(fitted: Fitted) -> bool:
    """Whether a fit knows inertias and stiffness."""
    core = np.array([name in POSITIVE for name in fitted.names], dtype=np.bool_)
    known = np.abs(fitted.values) > _KNOWN * fitted.unit_deviations
    return bool(np.all(known[core] & ~fitted.minimum.reduced.free[core]))


def beyond_noise(fitted: Fitted, floor: float, shortest: Fitted) -> float:
    """Weighted sum of squares beyond what noise explains, and beyond chance."""
    freedom = fitted.problem.degrees_of_freedom
    # Longer segments leave the noise that shorter ones took for initial states.
    states = shortest.minimum.point.initial_states.size
    return freedom * (fitted.excess - floor) - _CHANCE * float(np.sqrt(2.0 * states))


def led_from(
    fitted: Fitted,
    structure: Structure,
    start: Mapping[str, float] | None = None,
    *,
    data: Data | None = None,
    steps: Steps = ON_THE_WAY,
) -> Fitted | None:
    """Another structure over a fit's segments, from its states and values; None if it fails."""
    states, segments = fitted.minimum.point.initial_states, fitted.problem.segments
    begun = fitted.by_name if start is None else start
    with suppress(ConvergenceError):
        return fit_segments(structure, data or fitted.data, segments, begun, states, steps)
    return None


def over_longer(fitted: Fitted[M], segments: Segments, steps: Steps) -> Fitted[M]:
    """The same fit over longer segments, from where it ended."""
    before = fitted.minimum.point.initial_states
    states = before[:: len(before) // len(segments)]
    start = fitted.by_name
    return fit_segments(fitted.structure, fitted.data, segments, start, states, steps)


def with_steps_refined(found: Sequence[Fitted]) -> tuple[Fitted, ...]:
    """The same fits, whose data want as short steps as the last of them shows."""
    last = found[-1]
    finer = refinement(last.problem, last.minimum)
    return tuple(replace(fit, data=replace(fit.data, refinement=finer)) for fit in found)


def in_own_steps(fitted: Fitted) -> Fitted:
    """A fit in steps as short as it wants itself; the same fit where those that it took are.

    It is asked once, and takes `MOST` times as many steps as usual at most. Where the shorter ones
    lead nowhere, it stays as it was.
    """
    data = fitted.data
    finer = min(data.refinement * refinement(fitted.problem, fitted.minimum), MOST)
    if finer <= data.refinement:
        return fitted
    wanted = replace(fitted, data=replace(data, refinement=finer))
    return fit_like(fitted.structure, wanted) or fitted


def fit_to(
    structure: Structure, data: Data, start: Mapping[str, float], duration: float
) -> tuple[Fitted, list[Fitted]]:
    """Fit to other data over segments of a length in s, from values that are nearly right.

    Returns the fit over segments of that length, in steps that suit these data, and rough fits
    over others, from the shortest up to four times as long.
    """
    divisions = lengths(data, duration)[::-2][::-1]  # what is nearly right needs no small steps
    # Short segments know little of a shape.
    shapes = {name: start.get(name, value) for name, value in structure.joint.first.items()}
    held = replace(structure, fixed={**shapes, **structure.fixed})
    found = fit_by_length(held, data, start, divisions)
    last = found[-1]
    if len(last.problem.segments) > len(divisions[-1]):
        raise ConvergenceError(
            "prediction error",
            "what fits short segments does not lead on to longer ones: shorten the segments",
        )
    states = last.minimum.point.initial_states
    nearly = {**shapes, **last.by_name}
    fitted = in_own_steps(refit(structure, data, nearly, divisions[-1], FINE, states))
    return fitted, [*found[:-1], fitted, *_beyond(fitted)]


def expanded(structure: Structure[M], fitted: Fitted[M]) -> Fitted[M]:
    """A wider structure about the values of a fit, not fitted itself: its quadratic form there."""
    before, timing = fitted.problem, structure.timing
    unknowns = structure.unknowns(fitted.data.groups)
    problem = replace(
        structure.joint.motion(before.segments, before.timing, unknowns),
        timing=replace(before.timing, hold=timing.hold, sought=timing.sought),
        substeps=before.substeps,
        weights=before.weights,
        observer=before.observer,
    )
    values = {**structure.joint.first, **structure.timing.delays, **fitted.by_name}
    point = Point(
        np.array([values.get(name, 0.0) for name in problem.names]),
        problem.with_memories(fitted.minimum.point.initial_states),
    )
    equations = problem.equations(point)
    minimum = Minimum(point, equations, problem.solve(equations), 0, np.inf)
    return Fitted(structure, fitted.data, problem, minimum, fitted.duration)


def _beyond(fitted: Fitted) -> list[Fitted]:
    """The same over segments of twice and four times the length, as far as these can be had."""
    divisions = [fitted.problem.segments]
    while len(divisions) < 3 and (longer := divisions[-1].merged()) is not None:
        divisions.append(longer)
    return longer_fits(fitted, divisions[1:])


def refit(
    structure: Structure,
    data: Data,
    start: Mapping[str, float],
    segments: Segments,
    tolerance: float,
    states: FloatArray | None,
) -> Fitted:
    """Fit over given segments, within bounds, from values and states that are nearly right."""

    def fit(own: Structure) -> Fitted:
        found = fit_segments(own, data, segments, start, states, Steps(tolerance))
        if not found.has_partners:
            raise ConvergenceError(
                "prediction error",
                f"a channel comes out more than {data.margin:g} s late, where it has no partners: "
                f"give its delay",
            )
        return found

    return within_bounds(structure, data, fit)


def within_bounds(structure: Structure, data: Data, fit: Callable[[Structure], Fitted]) -> Fitted:
    """A fit that keeps to the bounds of a structure; what ends at one is fixed there.

    A longer or leaner fit may leave the bound again, so the structure does not keep it there.
    """

    def fit_with(unknowns: Unknowns) -> Fitted:
        fixed = {c: v for c, v in unknowns.fixed.items() if c not in structure.absent}
        return fit(replace(structure, fixed={**structure.fixed, **fixed}))

    bounds = {c: b for c, b in structure.bounds.items() if c not in structure.absent}
    if not bounds:
        return fit(structure)
    fitted, at_bound = bounded_fit(fit_with, structure.unknowns(data.groups), bounds)
    structure = replace(structure, joint=fitted.structure.joint)
    return replace(fitted, structure=structure, at_bound=at_bound)


def fit_like(structure: Structure, fitted: Fitted, tolerance: float = FINE) -> Fitted | None:
    """Another structure over the same segments, from where a fit ended; None if it fails.

    Of a leaner structure the rest follows what is gone, if there is no way without.
    """
    segments, states = fitted.problem.segments, fitted.minimum.point.initial_states
    for start in chain((fitted.by_name,), with_some_zero(structure, fitted)):
        try:
            return refit(structure, fitted.data, start, segments, tolerance, states)
        except ConvergenceError:
            continue
    return None


def with_some_zero(structure: Structure[M], fitted: Fitted[M]) -> Iterator[dict[str, float]]:
    """Values of a fit of which some become zero, as the rest follows along its quadratic form."""
    sought = {*structure.unknowns(fitted.data.groups).names, *structure.timing.sought}
    gone = np.array([name not in sought for name in fitted.names])
    if not gone.any() or gone.all():
        return
    least = least_with(~gone, fitted.information, fitted.values)
    left = [name for name, lost in zip(fitted.names, gone, strict=True) if not lost]
    yield {**fitted.by_name, **dict(zip(left, least.values.tolist(), strict=True))}


def motion_at(
    structure: Structure[M],
    data: Data,
    segments: Segments,
    start: Mapping[str, float],
    states: FloatArray | None,
    refinement: int = 1,
) -> tuple[SegmentedMotion, Point]:
    """A structure's motion over segments, and where to begin: from values and states.

    Without states, of all segments, it begins near the measured positions. The refinement is how
    many times as many steps as usual it takes.
    """
    timing = replace(structure.timing, relative_to=data.relative_to)
    problem = structure.joint.motion(segments, timing, structure.unknowns(data.groups))
    if states is None or len(states) != len(segments):
        states = problem.start_states
    values = {**structure.joint.first, **start}
    point = Point(
        np.array([values.get(name, 0.0) for name in problem.names]), problem.with_memories(states)
    )
    return problem.at(point, 1.0 / data.noise, refinement), point


def fit_segments(
    structure: Structure[M],
    data: Data,
    segments: Segments,
    start: Mapping[str, float],
    states: FloatArray | None,
    steps: Steps,
) -> Fitted[M]:
    """Fit over given segments, without bounds."""
    finer = data.refinement if steps.tolerance <= FINE else 1
    problem, point = motion_at(structure, data, segments, start, states, finer)
    problem = steps.taken_by(problem)
    found = minimise(
        problem,
        point,
        steps.tolerance,
        insist=steps.insist,
        iterations=steps.iterations,
        enough=steps.enough,
        promised=steps.promised,
        least_gain=steps.least_gain,
    )
    values = dict(zip(problem.names, found.point.values.tolist(), strict=True))
    ended = structure.beginning_at(values)
    return Fitted(ended, data, problem, found, segments.mean_duration)
