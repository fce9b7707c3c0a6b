"""Unusual terms and delays of an arm's fit with disturbances."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from flexid.arms.disturbed import NEAR_STEPS, DisturbedFit, Job, likeliest_fit
from flexid.arms.unusual import Unusual, encoder_delays, likeliest, not_in, promises, unusual_parts
from flexid.errors import ConvergenceError
from flexid.estimators.channel_timing import INPUT, Timing
from flexid.identification.full_model.model import Data, Structure
from flexid.identification.preparation.joint import ElasticArm

# Least fall of -2 log(likelihood) by delays of both kinds, over the fall by all unusual terms. An
# error of the motor reached 0.06, a second delay 0.1 to 0.6.
_OTHER_DELAY = 0.1


def fit_disturbed(
    structure: Structure[ElasticArm], data: Data, starts: Sequence[Mapping[str, float]]
) -> DisturbedFit:
    """Return the likeliest fit from these starts, with unusual terms and delays it needs."""
    structure = replace(structure, timing=Timing("zero"))
    begun = likeliest_fit(Job.of(structure, data, starts[0]), starts)
    parts = unusual_parts(begun.fitted.structure)
    return with_likelier_delays(begun, _with_unusual_terms(begun, parts))


def _with_unusual_terms(found: DisturbedFit, parts: Sequence[Unusual]) -> DisturbedFit:
    """Return the fit with each of these terms and delays that makes it clearly likelier."""
    parts = [*parts]
    while parts:
        squares, best = found.fitted.minimum.equations.cost, found.best
        promised, part = likeliest(promises(best.fitted, parts))
        if promised > squares - part.least:
            break
        parts.remove(part)
        job = replace(found.job, structure=part.added(found.job.structure))
        with suppress(ConvergenceError):
            near = job.in_band.with_gains_of(best.fitted, best.fitted.by_name, NEAR_STEPS)
            if near.minimum.equations.cost < squares - part.least:
                other = job.in_band.fit(near.by_name, best.sizes, near)
                if other.cost < best.cost - part.least and part.is_possible(other.fitted.by_name):
                    found = DisturbedFit(job, other, ())
                    parts = not_in(job.structure, parts)
    return found


def with_likelier_delays(begun: DisturbedFit, every: DisturbedFit) -> DisturbedFit:
    """Return the fit with the likelier delays: of the inputs, of encoders, or both.

    `begun` is the fit without unusual terms, `every` the one with each that helps. A link encoder's
    delay looks like twice that delay of the inputs: stiffness times the delay moves from the
    damping to the link's friction, or from the motor's friction to the damping. An error of the
    motor then looks like a second delay. So both are fitted only if one explains clearly less.
    """
    sought, late = {*every.job.structure.timing.sought}, {*encoder_delays(begun.job.balance)}
    if not sought:
        return every
    parts = unusual_parts(begun.fitted.structure)
    alone = [
        every
        if others.isdisjoint(sought)
        else _with_unusual_terms(begun, [p for p in parts if others.isdisjoint(p.names)])
        for others in (late, {INPUT})
    ]
    one = min(alone, key=_cost_of)
    both = every
    if every in alone:
        both = _with_unusual_terms(one, not_in(one.job.structure, parts))
    least = _OTHER_DELAY * (_cost_of(begun) - _cost_of(both))
    chosen = both if _cost_of(both) < _cost_of(one) - least else one
    changes = (_by_delays(chosen, other, least) for other in (*alone, both))
    return replace(chosen, by_delays=tuple(changes))


def _cost_of(found: DisturbedFit) -> float:
    return found.best.cost


def _by_delays(chosen: DisturbedFit, other: DisturbedFit, least: float) -> dict[str, float]:
    """Return the possible error of each value if other delays are right than the chosen ones.

    It decreases if their cost is larger by more than `least`.
    """
    gap = max(_cost_of(other) - _cost_of(chosen), least)
    share = (least / gap) ** 2 / np.sqrt(3.0)  # uniformly distributed between both
    own, changed = chosen.fitted.by_name, other.fitted.by_name
    return {name: share * (changed.get(name, 0.0) - own[name]) for name in own}
