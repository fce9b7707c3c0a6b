"""Start values of a fit: several least-squares solutions, of which the best are tried.

Least squares fits the acceleration of each row. With dry friction this is biased: while a side
sticks, friction balances the other torques and there is no acceleration, so all coefficients come
out too small by one factor. While a side keeps moving in one direction, its friction is constant
and the row is exact. The residuals over the shortest segments show which samples and which filter
are better.

From the best start the fit converges over all short segments on nearly every drive that the model
describes. It may fail after a jolt, on a drive that swings several times within the shortest
segments, or on one that hardly moves. Then other starts and longer segments are tried. If all fail,
the log is fitted with disturbances.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, islice, tee
from typing import Literal

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import USUAL, Steps
from flexid.estimators.samples import Segments, first_states, side_by_side
from flexid.estimators.state_variable_filter import FASTEST, LeastSquaresFit, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.identification.full_model.fitting import (
    FIRST_STEPS,
    fit_by_length,
    in_part,
    motion_at,
)
from flexid.identification.full_model.model import Data, Fitted, M, Structure
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models import flexible_joint as declared

RATES = (20.0, 60.0, 7.0, 200.0)
"""Filter rates of least squares, in 1/s."""

DIRECTED = 0.99  # least filtered direction of a side that has kept moving
_FEWEST_EACH = 10  # least number of samples for each coefficient
_COMPARED = 50  # segments over which starts are compared
_FILTER_RATE = 20.0  # 1/s, least rate of the filter for the effect of each term on its row
_PASSED = 1.0 / 3.0  # least rate of that filter over the resonance, to pass the joint's motion

_CLAMPED = 1e-3  # motor's inertia over the link's, as the start for a clamped link
_STARTS = 3  # most starts that are tried
_TOGETHER = 2  # starts that run at the same time
_SHORT = 0.5  # s, length of short segments
_SAME = 0.01  # relative difference of two sums of squares at one minimum


def starts(structure: Structure, data: Data, segments: Segments) -> Iterator[dict[str, float]]:
    """Yield start values of a fit, the most promising first.

    If one step from the first start leaves no more than noise, the starts are not compared.
    """
    candidates = _candidates(structure, data)
    first = next(candidates, None)
    if first is None:
        raise ConvergenceError("least squares", "nearly all of the log is rest: log more motion")
    some = segments.some(_COMPARED)
    problem, point = motion_at(structure, data, some, first, first_states(some))
    equations = problem.equations(point)
    promised = equations.cost - problem.solve(equations).decrement
    every = chain([first], candidates)
    if promised > THRESHOLDS.sensor_excess * problem.degrees_of_freedom:
        every = by_misfit(structure, data, segments, every)
    yield from every


def _candidates(structure: Structure, data: Data) -> Iterator[dict[str, float]]:
    """Yield least-squares values for each filter rate."""
    # Given frictions are sought too, since only sought ones show the samples while moving.
    given = {c: value for c, value in structure.fixed.items() if c not in declared.DRY_FRICTIONS}
    sought = replace(structure, fixed=given)
    for rate in RATES:
        start, fit = least_squares_start(sought, data, rate)
        candidates = [start]
        if moving := _while_moving(fit):
            candidates.append(_start_values(sought, {**fit.by_name, **moving}))
        # At rest a stiffness or gain may come out zero, and others are divided by it.
        yield from (w for w in candidates if all(w.get(name) != 0.0 for name in declared.POSITIVE))


def by_misfit(
    structure: Structure[M],
    data: Data,
    segments: Segments,
    candidates: Iterable[dict[str, float]],
    steps: Steps = USUAL,
) -> list[dict[str, float]]:
    """Return start values, the one with the least residuals over some segments first."""
    some = segments.some(_COMPARED)
    states = first_states(some)
    return sorted(
        candidates, key=lambda start: _misfit(structure, data, some, start, states, steps)
    )


def _misfit(
    structure: Structure[M],
    data: Data,
    segments: Segments,
    start: Mapping[str, float],
    states: FloatArray,
    steps: Steps,
) -> float:
    """Return the mean logarithm of a start's residuals over segments with fitted initial states."""
    # A good start may still fail in segments where a side sticks or is jolted. These would dominate
    # a sum.
    problem, point = motion_at(structure, data, segments, start, states)
    problem = steps.taken_by(problem)
    equations = problem.equations(point, "states")
    if not np.isfinite(equations.cost):
        return np.inf
    left = equations.costs - problem.solve(equations).by_states
    return float(np.mean(np.log(np.maximum(left / segments.lengths, 1.0))))


def _while_moving(fit: LeastSquaresFit) -> dict[str, float]:
    """Return least squares of each row over the samples at which its side kept moving one start."""
    # There the filtered direction of the motion is 1 or -1, so the side neither reversed nor stuck
    # within the filter's memory. A row is left out if such samples are few, or if all are.
    found: dict[str, float] = {}
    for row in fit.rows:
        frictions = [i for i, c in enumerate(row.coefficients) if c in declared.DRY_FRICTIONS]
        moving = np.all(np.abs(row.regressors[frictions]) >= DIRECTED, axis=0)
        few = np.count_nonzero(moving) < _FEWEST_EACH * len(row.coefficients)
        if few or moving.all():
            continue
        found |= dict(zip(row.coefficients, row.over(moving).tolist(), strict=True))
    return found


def least_squares_start(
    structure: Structure, data: Data, filter_rate: float
) -> tuple[dict[str, float], LeastSquaresFit]:
    """Return start values and least squares with smoothed friction and without delays."""
    unknowns = smooth_unknowns(structure, data.groups)
    hold = "zero" if structure.timing.hold == "zero" else "linear"
    fit = filtered_least_squares(data.samples, unknowns.system, filter_rate, hold, unknowns)
    return _start_values(structure, fit.by_name), fit


def _start_values(structure: Structure, values: Mapping[str, float]) -> dict[str, float]:
    """Return start values from least squares, with given values and delays."""
    return {**structure.timing.delays, **_passive({**structure.fixed, **values})}


def _passive(values: Mapping[str, float]) -> dict[str, float]:
    """Return start values of a passive joint, whose motion cannot diverge."""
    # Least squares of channels with different delays may have negative frictions and stiffnesses.
    found = {}
    for name, value in values.items():
        base = name.partition("[")[0]
        if base in declared.DAMPING:
            found[name] = 0.0
        elif base in declared.DISSIPATIVE | declared.HARDENING:
            found[name] = max(value, 0.0)
        elif base in declared.POSITIVE:
            found[name] = abs(value)
        else:
            found[name] = value
    link, motor = declared.SPRING
    if found.get(link) == 0.0:  # a clamped link starts as a heavy one
        found[link] = _CLAMPED * found.get(motor, 0.0)
    # One spring acts on both rows. The link's row has positions alone and shows its shape best.
    for name in declared.HARDENING & declared.TIES.keys() & found.keys():
        motor, by_link, by_motor = declared.TIES[name]
        if {motor, by_link, by_motor} <= found.keys() and values[by_link] > 0.0:
            found[motor] = found[name] * found[by_motor] / found[by_link]
    return found


def suited_rate(fitted: Fitted, asked: float | Literal["auto"] = "auto") -> float:
    """Return the rate in 1/s of a filter that passes the joint's motion, unless one is given."""
    if asked != "auto":
        return asked
    fastest = FASTEST / max(samples.sample_time for samples in fitted.data.samples)
    return min(max(_FILTER_RATE, _PASSED * declared.resonance(fitted.by_name)), fastest)


def smooth_unknowns(structure: Structure, groups: Sequence[int]) -> Unknowns:
    """Return the unknowns for least squares: with smoothed friction, without ties."""
    joint = structure.joint
    smooth = joint.smooth
    absent = structure.absent
    given = {c: v for c, v in structure.fixed.items() if c in smooth.coefficients}
    off = {c: 0.0 for c in smooth.coefficients if c in absent | declared.SQUARES}
    # If the source of a tie is off, the tied coefficient is off too.
    off |= {
        c: 0.0
        for c, (source, _, _) in joint.ties.items()
        if c in smooth.coefficients and source in absent
    }
    sought = structure.unknowns(groups)
    return Unknowns(smooth, {**off, **given}, sought.per_group, tuple(groups))


def unexplained_link(fit: LeastSquaresFit) -> float:
    """Return the share of the link's squared acceleration that least squares does not explain."""
    (link,) = (row for row in fit.rows if row.name == "link")
    return link.residual_sum / link.total_sum if link.total_sum else 0.0


def first_fits(
    structure: Structure, data: Data, divisions: Sequence[Segments], *, insist: bool = True
) -> list[Fitted]:
    """Fit over segments of growing length, from the start with the least final residuals.

    Returns the fits over the short segments, or over the longest if the model explains these at
    once. Without `insist`, the fit from the best start is returned even if no fit converged.
    """
    last = len(short(divisions)[-1])

    def should_continue(fitted: Fitted) -> bool:
        return len(fitted.problem.segments) > last

    candidates: Iterator[Mapping[str, float]] = islice(
        starts(structure, data, divisions[0]), _STARTS
    )
    for place in range(len(short(divisions))):
        # The first start is enough for most logs. Longer segments show more above the noise.
        count, together = (_TOGETHER, _TOGETHER) if place else (_STARTS, 1)
        best: list[Fitted] = []
        excessive_delays: set[str] = set()
        candidates, own = tee(candidates)
        for found in _fits_from_starts(
            structure, data, islice(own, count), divisions[place:], together, should_continue
        ):
            if not found[-1].has_partners:
                excessive_delays |= found[-1].excessive_delays
                continue
            confirmed = len(found) == len(best) and _same_minimum(found, best)
            best = _better(found, best)
            if confirmed or not should_continue(best[-1]):
                break
        if best:
            return best
        if excessive_delays:  # the log does not determine these delays, which exceed its margin
            return first_fits(structure.without(excessive_delays), data, divisions, insist=insist)
    if not insist:
        steps = replace(FIRST_STEPS, insist=False)
        start = next(candidates)
        return fit_by_length(
            structure, data, start, divisions, steps=steps, should_continue=should_continue
        )
    raise no_start()


def short(divisions: Sequence[Segments]) -> Sequence[Segments]:
    """Return the short divisions, over which starts are compared and the hold hardly matters."""
    return [each for each in divisions if each.mean_duration <= _SHORT] or divisions[:1]


def no_start() -> ConvergenceError:
    """Return the error of a log on which the fit fails from every start."""
    return ConvergenceError(
        "prediction error",
        "the fit of this log fails from every start: check the channels, their units and signs",
    )


def _fits_from_starts(
    structure: Structure,
    data: Data,
    candidates: Iterator[Mapping[str, float]],
    divisions: Sequence[Segments],
    together: int,  # number of starts that run at the same time
    should_continue: Callable[[Fitted], bool],
) -> Iterator[list[Fitted]]:
    """Yield the fits from each start from which the fit over the first division succeeds."""
    # From a minimum over that division which an earlier start has reached too, its fits are
    # yielded.
    first = in_part(divisions[0])

    def fits_from(start: Mapping[str, float], known: Sequence[list[Fitted]] = ()) -> list[Fitted]:
        reached: list[list[Fitted]] = []  # known fits from the same minimum

        def goes_on(fitted: Fitted) -> bool:
            reached.extend(own for own in known if _is_same(own[0], fitted))
            return should_continue(fitted) and not reached

        try:
            if first is not divisions[0]:
                some = fit_by_length(structure, data, start, [first], steps=FIRST_STEPS)
                start = some[0].by_name
            found = fit_by_length(
                structure, data, start, divisions, steps=FIRST_STEPS, should_continue=goes_on
            )
        except ConvergenceError:
            return []
        return reached[0] if reached else found

    every = [*filter(None, side_by_side(fits_from, islice(candidates, together)))]
    yield from every
    for start in candidates:
        if found := fits_from(start, every):
            every.append(found)
            yield found


def _is_same(one: Fitted, other: Fitted) -> bool:
    """Whether two fits over the same segments have the same values, within their deviations."""
    if len(one.problem.segments) != len(other.problem.segments):
        return False
    return bool(np.all(np.abs(one.values - other.values) <= one.unit_deviations))


def _same_minimum(one: Sequence[Fitted], other: Sequence[Fitted]) -> bool:
    """Whether two series of fits of equal length end in the same minimum."""
    ends = sorted(found[-1].minimum.equations.cost for found in (one, other))
    return ends[1] <= (1.0 + _SAME) * ends[0]


def _better(one: list[Fitted], other: list[Fitted]) -> list[Fitted]:
    """Return the series of fits with smaller residuals over the longest common segments."""
    costs = [{len(f.problem.segments): f.minimum.equations.cost for f in c} for c in (one, other)]
    common = costs[0].keys() & costs[1].keys()
    if not common:
        return one if min(costs[0], default=np.inf) < min(costs[1], default=np.inf) else other
    first, second = (cost[min(common)] for cost in costs)
    if abs(first - second) <= _SAME * min(first, second):
        return one if min(costs[0]) < min(costs[1]) else other
    return one if first < second else other
