"""First fits: the full model over short segments, from the start that leads furthest.

One start over one length of segments is no good on some logs: after a jolt, on a drive that swings
several times in the shortest segments, or that hardly moves, the steps end in another minimum or
nowhere. Another start, or segments of a quarter of the length, then lead where all lead that do not
fail. So they are tried until one explains the log, or two end alike, be it before they get there.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, product

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT
from flexid.estimators.segments import Segments
from flexid.identification.full_model.fitting import fit_by_length
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import starts
from flexid.identification.vocabulary.thresholds import Thresholds

FIRST_ITERATIONS = 8
"""Steps that a fit from afar may take, those that halve the sum of squares not counted."""

_HALVINGS = 2  # of the shortest segments, if these are too long to begin with
_FEWEST_HALVED = 10  # samples of what only leads to a start: twice its initial state
_FIRST_STARTS = 3  # that are tried over both before the others
_HOPELESS = 2  # starts that leave far more than noise, after which no other is tried
_SAME = 0.01  # relative difference of two sums of squares at one minimum
_FEW = frozenset({"theta1", "alpha2", "alpha_coulomb", "gamma1", "gamma_viscous", "gamma_coulomb"})


def first_fits(
    structures: Sequence[Structure],
    data: Data,
    divisions: Sequence[Segments],
    thresholds: Thresholds,
) -> list[Fitted]:
    """Fit over short segments of growing length, from the start that leads to the least residuals.

    Returns fits from the first of the divisions on, as far as `fit_by_length` leads.
    """
    structure, *others = structures
    ways = starts(structure, data, divisions[0])
    tries = [_tries(structure, data, divisions, ways)]
    tries += [_tries(other, data, divisions, ways[:1]) for other in others]
    best: list[Fitted] = []
    confirmed, hopeless = False, 0
    for found in chain(*tries):
        hopeless += found[-1].unexplained > thresholds.shape_motion
        if hopeless == _HOPELESS:
            return _better(found, best)
        before, best = best, _better(found, best)
        explained = best[-1].excess <= thresholds.sensor_excess
        if explained and len(best) == len(divisions):
            return best
        confirmed = len(found) == len(before) and (explained or _alike(found, before))
        if confirmed:
            break
    if best and best[-1].excess <= thresholds.sensor_excess:
        return best
    if confirmed and len(best) == len(divisions):
        return best
    try:
        smaller = _by_smaller_models(structure, data, divisions, ways[0])
    except ConvergenceError:
        if not best:
            raise
        return best
    return _better(smaller, best)


def _tries(
    structure: Structure,
    data: Data,
    divisions: Sequence[Segments],
    ways: Sequence[Mapping[str, float]],
) -> Iterator[list[Fitted]]:
    """Fits from one start after the other that reach the divisions."""
    finer: list[Segments] = []
    for _ in range(_HALVINGS):
        shortest = (*finer, *divisions)[0]
        if shortest.lengths.min() >= 2 * _FEWEST_HALVED:
            finer = [shortest.halved(), *finer]
    begins = [[], finer] if finer else [[]]
    first, others = ways[:_FIRST_STARTS], ways[_FIRST_STARTS:]
    stuck: list[Fitted] = []  # of what leads not even there
    for before, way in (*product(begins, first), *product(begins, others)):
        lengths_fitted = [*before, *divisions]
        try:
            found = fit_by_length(structure, data, way, lengths_fitted, iterations=FIRST_ITERATIONS)
        except ConvergenceError:
            continue
        reached = found[len(before) :]
        if reached and reached[-1].has_partners:
            yield reached
        elif stuck and len(found) == len(stuck) and _alike(found, stuck):
            return
        elif not reached:
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


def _by_smaller_models(
    structure: Structure, data: Data, divisions: Sequence[Segments], way: Mapping[str, float]
) -> list[Fitted]:
    """FitsByLength with few terms, and go on from there with all."""
    few = structure.without(structure.joint.optional - _FEW)
    bare = few.without(structure.timing.sought)
    late = {INPUT} & {*structure.timing.sought}
    for small in (few, *([few.without(late)] if late else []), bare):
        try:
            found = fit_by_length(small, data, starts(small, data, divisions[0])[0], divisions)
        except ConvergenceError:
            continue
        if found[-1].has_partners:
            wider = [structure, structure.without(late)] if late else [structure]
            return _widened([*wider, *([few] if small is not few else [])], found) or found
    # No drive of this kind: be the fit as bad as it may.
    return fit_by_length(bare, data, way, divisions, insist=False)


def _widened(structures: Sequence[Structure], found: Sequence[Fitted]) -> list[Fitted]:
    """The first wider structure that can be fitted from where a fit ended; empty if none can."""
    last = found[-1]
    segments, states = [last.problem.segments], last.minimum.point.initial_states
    for structure in structures:
        try:
            wider = fit_by_length(structure, last.data, last.by_name, segments, states)
        except ConvergenceError:
            continue
        if wider[-1].has_partners:
            return wider
    return []
