"""Where the fit of a log begins: least squares of it, in several ways, and the best of these.

Least squares takes each row as its acceleration's explanation. On a drive with dry friction that
misleads: while a side sticks, friction balances whatever acts, and nothing of it is an
acceleration, so that all coefficients come out too small by one factor. While it keeps moving in
one direction its friction is a constant, and the row is exact. Which samples and which filter are
better shows in the residuals over the shortest segments.

The best start leads through all short segments on nearly every drive that the model describes.
After a jolt, on a drive that swings several times in the shortest segments, or that hardly moves,
its steps may end in another minimum or nowhere; another start, or segments of a quarter of the
length, then lead where all lead that do not fail. What they lead nowhere on is a matter of
disturbances.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, islice, tee
from typing import Literal, NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.samples import Segments, first_states, side_by_side
from flexid.estimators.state_variable_filter import FASTEST, LeastSquaresFit, filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.identification.full_model.fitting import (
    FIRST_STEPS,
    USUAL,
    Steps,
    fit_by_length,
    in_part,
    motion_at,
)
from flexid.identification.full_model.model import Data, Fitted, M, Structure
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models import flexible_joint as declared

RATES = (20.0, 60.0, 7.0, 200.0)
"""Of the filters of least squares, in 1/s."""

DIRECTED = 0.99  # of a filtered direction, from which on a side has kept moving
_FEWEST_EACH = 10  # samples for each coefficient
_COMPARED = 50  # segments over which starts are compared
_FILTER_RATE = 20.0  # 1/s, of least squares that shows what each term does to its row
_PASSED = 1.0 / 3.0  # of the resonance, from which on such a filter hides none of a joint's motion

_HALVINGS = 2  # of the shortest segments, if these are too long to begin with
_FEWEST_HALVED = 10  # samples of what only leads to a start: twice its initial state
_CLAMPED = 1e-3  # of the motor's inertia over that of a link that does not move, to begin with
_STARTS = 3  # that are tried
_TOGETHER = 2  # of them, that run at the same time
_SHORT = 0.5  # s
_SAME = 0.01  # relative difference of two sums of squares at one minimum


def starts(structure: Structure, data: Data, segments: Segments) -> Iterator[dict[str, float]]:
    """Values that a fit may begin with, the most promising first.

    If a step from the first leaves no more than noise, it need not be compared with the others.
    """
    ways = _ways(structure, data)
    first = next(ways, None)
    if first is None:
        raise ConvergenceError("least squares", "nearly all of the log is rest: log more motion")
    some = segments.some(_COMPARED)
    problem, point = motion_at(structure, data, some, first, first_states(some))
    equations = problem.equations(point)
    promised = equations.cost - problem.solve(equations).decrement
    every = chain([first], ways)
    if promised > THRESHOLDS.sensor_excess * problem.degrees_of_freedom:
        every = by_misfit(structure, data, segments, every)
    yield from every


def _ways(structure: Structure, data: Data) -> Iterator[dict[str, float]]:
    """Values by least squares through one filter after the other."""
    # Which samples a friction is known at shows where it is sought, be it given or not.
    given = {c: value for c, value in structure.fixed.items() if c not in declared.DRY_FRICTIONS}
    sought = replace(structure, fixed=given)
    for rate in RATES:
        start, fit = least_squares_start(sought, data, rate)
        ways = [start]
        if moving := _while_moving(fit):
            ways.append(_begun(sought, {**fit.by_name, **moving}))
        # Of rest alone least squares makes springs of nothing, by which others are divided.
        yield from (w for w in ways if all(w.get(name) != 0.0 for name in declared.POSITIVE))


def by_misfit(
    structure: Structure[M],
    data: Data,
    segments: Segments,
    ways: Iterable[dict[str, float]],
    steps: Steps = USUAL,
) -> list[dict[str, float]]:
    """Values that a fit may begin with, the one first that leaves least in some segments."""
    some = segments.some(_COMPARED)
    states = first_states(some)
    return sorted(ways, key=lambda way: _misfit(structure, data, some, way, states, steps))


def _misfit(
    structure: Structure[M],
    data: Data,
    segments: Segments,
    way: Mapping[str, float],
    states: FloatArray,
    steps: Steps,
) -> float:
    """Mean logarithm of what a start leaves in the segments, once each begins where that suits it.

    A start may be nearly right and still go astray where a side sticks or is jolted: a sum would
    heed nothing else.
    """
    problem, point = motion_at(structure, data, segments, way, states)
    problem = steps.taken_by(problem)
    equations = problem.equations(point, "states")
    if not np.isfinite(equations.cost):
        return np.inf
    left = equations.costs - problem.solve(equations).by_states
    return float(np.mean(np.log(np.maximum(left / segments.lengths, 1.0))))


def _while_moving(fit: LeastSquaresFit) -> dict[str, float]:
    """Least squares of each row over the samples at which its friction is known but for its size.

    There the filtered direction of its motion is one or minus one, so that it has not turned round
    or stuck for as long as the filter remembers. A row of which these are few, or all, is left out.
    """
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
    """Least squares of the data with smoothed friction, delays ignored: where a fit begins."""
    unknowns = smooth_unknowns(structure, data.groups)
    hold = "zero" if structure.timing.hold == "zero" else "linear"
    fit = filtered_least_squares(data.samples, unknowns.system, filter_rate, hold, unknowns)
    return _begun(structure, fit.by_name), fit


def _begun(structure: Structure, values: Mapping[str, float]) -> dict[str, float]:
    """Where a fit begins, from values by least squares; what is given stands beside them."""
    return {**structure.timing.delays, **_passive({**structure.fixed, **values})}


def _passive(values: Mapping[str, float]) -> dict[str, float]:
    """Values of a joint that no motion can run away from: where a fit may begin.

    Least squares of channels that do not match in time has frictions that feed energy in, and
    springs that push.
    """
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
    if found.get(link) == 0.0:  # a clamped one, as if it were heavy
        found[link] = _CLAMPED * found.get(motor, 0.0)
    # One spring acts on both rows, and the link's, of positions alone, knows its shape best.
    for name in declared.HARDENING & declared.TIES.keys() & found.keys():
        motor, by_link, by_motor = declared.TIES[name]
        if {motor, by_link, by_motor} <= found.keys() and values[by_link] > 0.0:
            found[motor] = found[name] * found[by_motor] / found[by_link]
    return found


def suited_rate(fitted: Fitted, asked: float | Literal["auto"] = "auto") -> float:
    """Rate in 1/s of a filter that passes the motion of a joint as fitted, unless one is asked."""
    if asked != "auto":
        return asked
    fastest = FASTEST / max(samples.sample_time for samples in fitted.data.samples)
    return min(max(_FILTER_RATE, _PASSED * declared.resonance(fitted.by_name)), fastest)


def smooth_unknowns(structure: Structure, groups: Sequence[int]) -> Unknowns:
    """What least squares seeks of a structure: friction smoothed, no coefficients tied."""
    joint = structure.joint
    smooth = joint.smooth
    absent = structure.absent
    given = {c: v for c, v in structure.fixed.items() if c in smooth.coefficients}
    off = {c: 0.0 for c in smooth.coefficients if c in absent | declared.SQUARES}
    # Where the source of a tie is off, so is what follows from it.
    off |= {
        c: 0.0
        for c, (source, _, _) in joint.ties.items()
        if c in smooth.coefficients and source in absent
    }
    sought = structure.unknowns(groups)
    return Unknowns(smooth, {**off, **given}, sought.per_group, tuple(groups))


def unexplained_link(fit: LeastSquaresFit) -> float:
    """Share of the link's squared acceleration that no term of least squares explains."""
    (link,) = (row for row in fit.rows if row.name == "link")
    return link.residual_sum / link.total_sum if link.total_sum else 0.0


def first_fits(
    structure: Structure, data: Data, divisions: Sequence[Segments], *, insist: bool = True
) -> list[Fitted]:
    """Fit over segments of growing length, from the start that leads to the least residuals.

    Returns fits from the first of the divisions on, as far as `fit_by_length` leads: through the
    short ones, or to the longest if the model explains these at once. Without insisting on a fit
    whose steps end, the best start's is taken, be it as bad as it may.
    """
    last = len(short(divisions)[-1])

    def leads_on(fitted: Fitted) -> bool:
        return len(fitted.problem.segments) > last

    ways: Iterator[Mapping[str, float]] = islice(starts(structure, data, divisions[0]), _STARTS)
    for climb in _climbs(divisions):
        best: list[Fitted] = []
        astray: set[str] = set()
        ways, own = tee(ways)
        for found in _tries(structure, data, islice(own, climb.starts), climb, leads_on):
            if not found[-1].has_partners:
                astray |= found[-1].astray
                continue
            confirmed = len(found) == len(best) and _alike(found, best)
            best = _better(found, best)
            if confirmed or not leads_on(best[-1]):
                break
        if best:
            return best
        if astray:  # the log tells so little of these delays that they lead out of it
            return first_fits(structure.without(astray), data, divisions, insist=insist)
    if not insist:
        steps = replace(FIRST_STEPS, insist=False)
        way = next(ways)
        return fit_by_length(structure, data, way, divisions, steps=steps, leads_on=leads_on)
    raise no_start()


def short(divisions: Sequence[Segments]) -> Sequence[Segments]:
    """Those over which starts are compared, and any hold will do."""
    return [each for each in divisions if each.mean_duration <= _SHORT] or divisions[:1]


def no_start() -> ConvergenceError:
    """The error of a log that no start leads anywhere on."""
    return ConvergenceError(
        "prediction error",
        "the model follows this log from no start: check the channels, their units and signs",
    )


def _halved(shortest: Segments) -> list[Segments]:
    """Segments of a quarter and of half the length, as far as they are long enough."""
    finer: list[Segments] = []
    for _ in range(_HALVINGS):
        if shortest.lengths.min() < 2 * _FEWEST_HALVED:
            break
        shortest = shortest.halved()
        finer = [shortest, *finer]
    return finer


class _Climb(NamedTuple):
    """A way from short segments to long ones."""

    divisions: Sequence[Segments]
    finer: int = 0  # of these divisions, which a start has to come beyond
    starts: int = _STARTS  # that are tried
    together: int = _TOGETHER  # of them, that run at the same time


def _climbs(divisions: Sequence[Segments]) -> Iterator[_Climb]:
    """Ways to the longest segments, of which each is for logs that the ones before lead nowhere on.

    The first start is enough for most logs. What noise hides over the shortest segments longer ones
    show, and shorter ones forgive more.
    """
    yield _Climb(divisions, together=1)
    for place in range(1, len(short(divisions))):
        yield _Climb(divisions[place:], starts=_TOGETHER)
    if finer := _halved(divisions[0]):
        yield _Climb([*finer, *divisions], len(finer))


def _tries(
    structure: Structure,
    data: Data,
    ways: Iterator[Mapping[str, float]],
    climb: _Climb,
    leads_on: Callable[[Fitted], bool],
) -> Iterator[list[Fitted]]:
    """Fits from one start after the other that come beyond the first of the segments."""
    climbed, before = climb.divisions, climb.finer
    first = in_part(climbed[0])

    def led(way: Mapping[str, float]) -> list[Fitted]:
        try:
            if first is not climbed[0]:
                some = fit_by_length(structure, data, way, [first], steps=FIRST_STEPS)
                way = some[0].by_name
            return fit_by_length(
                structure, data, way, climbed, steps=FIRST_STEPS, leads_on=leads_on
            )
        except ConvergenceError:
            return []

    at_once = islice(ways, climb.together)
    stuck: list[Fitted] = []  # of what leads not even to the first length
    for found in chain(side_by_side(led, at_once), map(led, ways)):
        reached = [f for f in found if len(f.problem.segments) <= len(climbed[before])]
        if reached:
            yield reached
        elif stuck and len(found) == len(stuck) and _alike(found, stuck):
            return
        elif found:
            stuck = found


def _alike(one: Sequence[Fitted], other: Sequence[Fitted]) -> bool:
    """Whether two series of fits that are as long end in one minimum."""
    ends = sorted(found[-1].minimum.equations.cost for found in (one, other))
    return ends[1] <= (1.0 + _SAME) * ends[0]


def _better(one: list[Fitted], other: list[Fitted]) -> list[Fitted]:
    """Of two series of fits the one with less residuals over the longest common segments."""
    costs = [{len(f.problem.segments): f.minimum.equations.cost for f in c} for c in (one, other)]
    common = costs[0].keys() & costs[1].keys()
    if not common:
        return one if min(costs[0], default=np.inf) < min(costs[1], default=np.inf) else other
    first, second = (cost[min(common)] for cost in costs)
    if abs(first - second) <= _SAME * min(first, second):
        return one if min(costs[0]) < min(costs[1]) else other
    return one if first < second else other
