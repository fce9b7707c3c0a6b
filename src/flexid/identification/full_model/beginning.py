"""First fits: the full model over short segments, from the start that leads furthest.

The best start by least squares leads through all short segments on nearly every drive that the
model describes. After a jolt, on a drive that swings several times in the shortest segments, or
that hardly moves, its steps may end in another minimum or nowhere; another start, or segments of a
quarter of the length, then lead where all lead that do not fail. What they lead nowhere on is a
matter of disturbances.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from flexid.errors import ConvergenceError
from flexid.estimators.segments import Segments
from flexid.identification.full_model.fitting import fit_by_length
from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.full_model.starting import starts

FIRST_ITERATIONS = 8
"""Steps that a fit from afar may take, those that halve the sum of squares not counted."""

_HALVINGS = 2  # of the shortest segments, if these are too long to begin with
_FEWEST_HALVED = 10  # samples of what only leads to a start: twice its initial state
_STARTS = 3  # that are tried
_SAME = 0.01  # relative difference of two sums of squares at one minimum


def first_fits(
    structure: Structure, data: Data, divisions: Sequence[Segments], *, insist: bool = True
) -> list[Fitted]:
    """Fit over short segments of growing length, from the start that leads to the least residuals.

    Returns fits from the first of the divisions on, as far as `fit_by_length` leads. Without
    insisting on a fit whose steps end, the best start's is taken, be it as bad as it may.
    """
    ways = starts(structure, data, divisions[0])[:_STARTS]
    finer = _halved(divisions[0])
    for before in [[], finer] if finer else [[]]:
        best: list[Fitted] = []
        astray: set[str] = set()
        for found in _tries(structure, data, ways, before, divisions):
            if not found[-1].has_partners:
                astray |= found[-1].astray
                continue
            confirmed = len(found) == len(best) and _alike(found, best)
            best = _better(found, best)
            if confirmed or len(best) == len(divisions):
                break
        if best:
            return best
        if astray:  # the log tells so little of these delays that they lead out of it
            return first_fits(structure.without(astray), data, divisions, insist=insist)
    if not insist:
        return fit_by_length(
            structure, data, ways[0], divisions, insist=False, iterations=FIRST_ITERATIONS
        )
    raise no_start()


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


def _tries(
    structure: Structure,
    data: Data,
    ways: Sequence[Mapping[str, float]],
    before: Sequence[Segments],
    divisions: Sequence[Segments],
) -> Iterator[list[Fitted]]:
    """Fits from one start after the other, by way of other segments, that reach the divisions."""
    climbed = [*before, *divisions]
    stuck: list[Fitted] = []  # of what leads not even there
    for way in ways:
        try:
            found = fit_by_length(structure, data, way, climbed, iterations=FIRST_ITERATIONS)
        except ConvergenceError:
            continue
        reached = found[len(before) :]
        if reached:
            yield reached
        elif stuck and len(found) == len(stuck) and _alike(found, stuck):
            return
        else:
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
