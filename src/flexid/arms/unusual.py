"""What an arm may have beyond the usual: terms that are zero at first, and channels that are late.

One pass over the log tells what all of them promise: a quadratic form about the fit so far.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.estimators.channel_timing import DELAY, INPUT
from flexid.estimators.normal_equations import scaled_inverse
from flexid.identification.full_model.fitting import expanded
from flexid.identification.full_model.model import Fitted, Structure
from flexid.identification.preparation.arm import ElasticArm
from flexid.models.torque_balance import TorqueBalance
from flexid.recording.recording import Hold

UNUSUAL_FALL = 25.0
"""Of the weighted squares, over their variance, that what is unusual brings at least."""

FittedArm = Fitted[ElasticArm]
ArmStructure = Structure[ElasticArm]


@dataclass(frozen=True)
class Unusual:
    """One parameter more that may be sought: that of a term, or the delay of a channel."""

    name: str
    hold: Hold | None = None  # how the inputs behave; None where that stays as it was

    def added(self, structure: ArmStructure) -> ArmStructure:
        """The structure with it."""
        fixed = {name: value for name, value in structure.fixed.items() if name != self.name}
        timing = replace(structure.timing, hold=self.hold or structure.timing.hold)
        if self.name not in structure.joint.balance.coefficients:
            timing = replace(timing, sought=tuple(dict.fromkeys((*timing.sought, self.name))))
        return replace(structure, fixed=fixed, timing=timing)


LINES = Unusual(INPUT, "linear")
"""Inputs on straight lines between samples, and late: much like held ones with another delay."""


def unusual_parts(structure: ArmStructure) -> list[Unusual]:
    """Terms that a structure does not have yet, and delays of the inputs and of each link."""
    balance = structure.joint.balance
    terms = [name for name in balance.unusual if name in structure.fixed]
    return [*map(Unusual, terms), Unusual(INPUT), *map(Unusual, link_delays(balance))]


def link_delays(balance: TorqueBalance) -> tuple[str, ...]:
    """Name of the delay of each link's encoder, of which that of the motor is on time."""
    return tuple(f"{row.name}{DELAY}" for row in balance.rows[::2])


def promises(fitted: FittedArm, parts: Sequence[Unusual]) -> Iterator[tuple[float, Unusual]]:
    """The weighted squares that one step from a fit promises with each part, and the part.

    A fit that has not ended would go on as it is as well: that is no merit of a part.
    """
    holds = [part.hold or fitted.structure.timing.hold for part in parts]
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
