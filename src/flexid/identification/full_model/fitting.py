"""Fits of a model to a log over segments of growing length.

The fit over short segments starts from least squares. Each longer fit starts from the values and
states of the one before it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.normal_equations import least_with
from flexid.estimators.prediction_error import (
    FINE,
    MOST,
    NEARLY_NOISE,
    Minimum,
    Steps,
    minimise,
    refinement,
)
from flexid.estimators.samples import Segments, divide
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.unknowns import Unknowns, bounded_fit
from flexid.identification.full_model.model import Data, Fitted, M, Structure
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import POSITIVE

SHORTEST = 0.1
"""Length in s of the first segments of a fit, over which it converges from a rough start."""

LONGEST = 10.0
"""Length in s of the longest segments; longer ones have hardly more information."""

_CHANCE = 3.0  # standard deviations of a sum of squares
# Least value of inertias and stiffness in standard deviations. With three to seven, on two slow
# sines and coarse encoders, a minimum with a motor inertia 40 % off explained the log as well.
_KNOWN = 20.0
# Ratio of mean squared residuals after and before terms are removed, above which a fit may be in a
# wrong minimum. For a free swing of 10 s, without 2 % of its restoring torque, it was 8e5.
_CLEARLY_WORSE = 2.0
_ENOUGH = 10_000  # samples that suffice for a trial


ON_THE_WAY = Steps(enough=NEARLY_NOISE)
"""Steps of an intermediate fit."""

FIRST_STEPS = replace(ON_THE_WAY, iterations=8)
"""Steps of a fit from a rough start; those that halve the sum of squares are not counted."""

EXPLORING = replace(FIRST_STEPS, insist=False, least_gain=0.01)
"""Steps of a fit that shows whether a term is worth a full fit."""

_AT_ONCE = Steps(0.1, iterations=5, promised=NEARLY_NOISE)


def lengths(data: Data, longest: float = LONGEST) -> list[Segments]:
    """Return divisions into segments of growing length, each twice as long as the one before."""
    first = divide(data.samples, min(longest, data.duration), margin=data.margin)
    found = [first]
    while True:
        last = found[-1]
        if last.mean_duration < 1.5 * SHORTEST or not last.can_be_halved:
            return found[::-1]
        found.append(last.halved())


def in_part(segments: Segments) -> Segments:
    """Return evenly spread segments with enough samples for a trial, or all if they are few."""
    count = max(1, int(_ENOUGH / segments.lengths.mean()))
    return segments if len(segments) < 2 * count else segments.some(count)


def fit_by_length(
    structure: Structure,
    data: Data,
    start: Mapping[str, float],
    divisions: Sequence[Segments],
    states: FloatArray | None = None,  # (n_segments, n_states)
    steps: Steps = ON_THE_WAY,
    should_continue: Callable[[Fitted], bool] = lambda _: True,
) -> list[Fitted]:
    """Fit over the first division, and from there over the longer ones."""
    first = fit_segments(structure, data, divisions[0], start, states, steps)
    return [first, *longer_fits(first, divisions[1:], should_continue)]


def longer_fits(
    first: Fitted,
    divisions: Sequence[Segments],
    should_continue: Callable[[Fitted], bool] = lambda _: True,
) -> list[Fitted]:
    """Return fits over those divisions whose segments are longer than those of `first`.

    If a fit over the longest segments explains the log at once, it is the only one. Otherwise each
    length starts from the fit before it. The series ends at the first length at which the fit
    fails, or after a fit for which `should_continue` is false. A fit that did not converge is kept
    if its residuals are nearly noise.
    """
    longer = [each for each in divisions if len(each) < len(first.problem.segments)]
    if len(longer) > 1 and (whole := _explained_over(longer[-1], first)) is not None:
        return [whole]
    last, found = first, []
    for segments in longer:
        if not should_continue(last):
            break
        try:
            last = over_longer(last, segments, ON_THE_WAY)
        except ConvergenceError:
            break
        found.append(last)
    return found


def _explained_over(longest: Segments, short: Fitted) -> Fitted | None:
    """Return a fit over the longest segments if it leaves no more than the short ones, or None."""
    # The short fit must determine inertias and stiffness. Otherwise several minima may explain the
    # log, and the lengths between are needed.
    if short.excess > THRESHOLDS.sensor_excess or not _is_known(short):
        return None
    with suppress(ConvergenceError):
        found = over_longer(short, longest, _AT_ONCE)
        floor = THRESHOLDS.noise_floor(short.excess)
        return found if beyond_noise(found, floor, short) <= 0.0 else None
    return None


def _is_known(fitted: Fitted) -> bool:
    """Whether a fit determines inertias and stiffness."""
    core = np.array([name in POSITIVE for name in fitted.names], dtype=np.bool_)
    known = np.abs(fitted.values) > _KNOWN * fitted.unit_deviations
    return bool(np.all(known[core] & ~fitted.minimum.reduced.free[core]))


def beyond_noise(fitted: Fitted, floor: float, shortest: Fitted) -> float:
    """Return the weighted sum of squares beyond noise and chance."""
    freedom = fitted.problem.degrees_of_freedom
    # Shorter segments fit part of the noise with their many initial states.
    states = shortest.minimum.point.initial_states.size
    return freedom * (fitted.excess - floor) - _CHANCE * float(np.sqrt(2.0 * states))


def fit_from(
    fitted: Fitted,
    structure: Structure,
    start: Mapping[str, float] | None = None,
    steps: Steps = ON_THE_WAY,
) -> Fitted | None:
    """Fit another structure over a fit's segments, from its states and values; None on failure."""
    states, segments = fitted.minimum.point.initial_states, fitted.problem.segments
    begun = fitted.by_name if start is None else start
    with suppress(ConvergenceError):
        return fit_segments(structure, fitted.data, segments, begun, states, steps)
    return None


def over_longer(fitted: Fitted[M], segments: Segments, steps: Steps) -> Fitted[M]:
    """Fit the same structure over longer segments, from the values and states of `fitted`."""
    before = fitted.minimum.point.initial_states
    states = before[:: len(before) // len(segments)]
    start = fitted.by_name
    return fit_segments(fitted.structure, fitted.data, segments, start, states, steps)


def with_steps_refined(found: Sequence[Fitted]) -> tuple[Fitted, ...]:
    """Return the fits with the refinement of integration steps that the last of them needs."""
    last = found[-1]
    usual = last.problem.at(last.minimum.point, last.problem.weights).substeps
    finer = last.problem.substeps * refinement(last.problem, last.minimum) // usual
    finer = min(max(1, finer), MOST)
    return tuple(replace(fit, data=replace(fit.data, refinement=finer)) for fit in found)


def in_own_steps(fitted: Fitted) -> Fitted:
    """Fit again with as short integration steps as the fit needs; unchanged if they are so.

    This is done once, with at most `MOST` times the usual number of steps. If the new fit fails,
    the old one is returned.
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
    """Fit to other data over segments of a length in s, from good start values.

    Returns the fit over segments of that length, with refined integration steps, and rough fits
    over other lengths, from the shortest up to four times as long.
    """
    divisions = lengths(data, duration)[::-2][::-1]  # a good start needs only every second length
    # Short segments hardly determine constants of shapes.
    shapes = {name: start.get(name, value) for name, value in structure.joint.first.items()}
    held = replace(structure, fixed={**shapes, **structure.fixed})
    found = fit_by_length(held, data, start, divisions)
    last = found[-1]
    if len(last.problem.segments) > len(divisions[-1]):
        raise ConvergenceError(
            "prediction error",
            f"the fit fails over segments of {duration:.3g} s: shorten the segments",
        )
    states = last.minimum.point.initial_states
    nearly = {**shapes, **last.by_name}
    fitted = in_own_steps(refit(structure, data, nearly, divisions[-1], FINE, states))
    longer = [fitted.problem.segments]
    while len(longer) < 3 and (doubled := longer[-1].merged()) is not None:
        longer.append(doubled)
    return fitted, [*found[:-1], fitted, *longer_fits(fitted, longer[1:])]


def expanded(structure: Structure[M], fitted: Fitted[M]) -> Fitted[M]:
    """Return a wider structure expanded about the values of a fit, without fitting it."""
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


def refit(
    structure: Structure,
    data: Data,
    start: Mapping[str, float],
    segments: Segments,
    tolerance: float,
    states: FloatArray | None,
) -> Fitted:
    """Fit over given segments, within bounds, from good start values and states."""

    def fit(own: Structure) -> Fitted:
        found = fit_segments(own, data, segments, start, states, Steps(tolerance))
        if not found.has_partners:
            raise ConvergenceError(
                "prediction error",
                f"the delay of a channel comes out above {data.margin:g} s, beyond the data's "
                f"margin: give its delay",
            )
        return found

    return within_bounds(structure, data, fit)


def within_bounds(structure: Structure, data: Data, fit: Callable[[Structure], Fitted]) -> Fitted:
    """Fit within the bounds of a structure; coefficients that end at a bound are fixed there.

    The returned structure does not fix them, since a longer or leaner fit may leave the bound.
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
    """Fit another structure over the same segments, from a fit's values; None on failure.

    For a leaner structure there is a second start: the other values follow the removed ones. It is
    tried if the first fails, or seems to end in a wrong minimum.
    """
    segments, states = fitted.problem.segments, fitted.minimum.point.initial_states
    best: Fitted | None = None
    for start in chain((fitted.by_name,), with_some_zero(structure, fitted)):
        with suppress(ConvergenceError):
            found = refit(structure, fitted.data, start, segments, tolerance, states)
            best = found if best is None or found.excess < best.excess else best
        if best is not None and best.excess <= _CLEARLY_WORSE * fitted.excess:
            break
    return best


def with_some_zero(structure: Structure[M], fitted: Fitted[M]) -> Iterator[dict[str, float]]:
    """Yield values with removed ones at zero, the rest following along the quadratic form."""
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
    """Return a structure's motion over segments, and the start point from values and states.

    Without states for all segments, it starts near the measured positions. `refinement` multiplies
    the number of integration steps.
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
    found = minimise(problem, point, steps)
    values = dict(zip(problem.names, found.point.values.tolist(), strict=True))
    ended = structure.beginning_at(values)
    return Fitted(ended, data, problem, found, segments.mean_duration)
