"""What an arm may have beyond the usual: terms that are zero at first, and inputs that are late.

One pass over the log tells what all of them promise: a quadratic form about the fit so far.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.estimators.channel_timing import INPUT, Timing
from flexid.estimators.normal_equations import scaled_inverse
from flexid.identification.full_model.fitting import expanded
from flexid.identification.full_model.model import Fitted, Structure
from flexid.identification.preparation.arm import ElasticArm

UNUSUAL_FALL = 25.0
"""Of the weighted squares, over their variance, that what is unusual brings at least."""

FittedArm = Fitted[ElasticArm]
ArmStructure = Structure[ElasticArm]


@dataclass(frozen=True)
class Unusual:
    """One parameter more that may be sought."""

    name: str
    timing: Timing | None = None  # of the inputs; None where that stays what it was

    def added(self, structure: ArmStructure) -> ArmStructure:
        """The structure with it."""
        fixed = {name: value for name, value in structure.fixed.items() if name != self.name}
        return replace(structure, fixed=fixed, timing=self.timing or structure.timing)


def unusual_terms(structure: ArmStructure) -> list[Unusual]:
    """Terms that a structure does not have yet."""
    return [Unusual(n) for n in structure.joint.balance.unusual if n in structure.fixed]


def late(timing: Timing) -> Unusual:
    """Inputs that behave like that, and act later than they were logged, or earlier."""
    return Unusual(INPUT, replace(timing, sought=(INPUT,)))


def promises(fitted: FittedArm, parts: Sequence[Unusual]) -> Iterator[tuple[float, Unusual]]:
    """The weighted squares that one step from a fit promises with each part, and the part.

    A fit that has not ended would go on as it is as well: that is no merit of a part.
    """
    holds = [(part.timing or fitted.structure.timing).hold for part in parts]
    for hold in dict.fromkeys(holds):
        own = [part for part, other in zip(parts, holds, strict=True) if other == hold]
        wide = fitted.structure
        for part in own:
            wide = part.added(wide)
        seen = expanded(wide, fitted)
        reduced, score = seen.minimum.reduced, seen.minimum.reduced.scores.sum(axis=1)
        squares = seen.minimum.equations.cost - float(reduced.by_states.sum())
        for part in own:
            sought = np.array([name in {*fitted.names, part.name} for name in seen.names])
            information = reduced.information[np.ix_(sought, sought)]
            scale = np.sqrt(np.maximum(np.diag(information), 0.0))
            inverse, _ = scaled_inverse(information, scale)
            fall = float(score[sought] @ inverse @ score[sought])
            yield squares - fall + fitted.minimum.reduced.decrement, part
