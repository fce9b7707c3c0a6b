"""Terms and delays of an arm that are fitted only if they help: cubic springs and late channels.

One pass over the log predicts the gain of all of them, from a quadratic approximation about the
current fit.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from flexid.estimators.channel_timing import DELAY, INPUT
from flexid.estimators.normal_equations import scaled_inverse
from flexid.identification.full_model.fitting import expanded
from flexid.identification.full_model.model import Fitted, Structure
from flexid.identification.preparation.joint import ElasticArm
from flexid.models.torque_balance import TorqueBalance
from flexid.recording.recording import Hold

UNUSUAL_FALL = 25.0
"""Fall of the weighted squares, over their variance, that each unusual parameter must bring."""

FittedArm = Fitted[ElasticArm]
ArmStructure = Structure[ElasticArm]


@dataclass(frozen=True)
class Unusual:
    """Parameters that may be fitted in addition: of an unusual term, or delays of channels."""

    names: tuple[str, ...]
    hold: Hold | None = None  # how the inputs behave between samples; None keeps it

    @property
    def least(self) -> float:
        """Fall of the weighted squares, over their variance, that the parameters must bring."""
        return UNUSUAL_FALL * len(self.names)

    def added(self, structure: ArmStructure) -> ArmStructure:
        """Return the structure with these parameters fitted."""
        fixed = {name: value for name, value in structure.fixed.items() if name not in self.names}
        timing = replace(structure.timing, hold=self.hold or structure.timing.hold)
        delays = (name for name in self.names if name not in structure.joint.balance.coefficients)
        timing = replace(timing, sought=tuple(dict.fromkeys((*timing.sought, *delays))))
        return replace(structure, fixed=fixed, timing=timing)


LINES = Unusual((INPUT,), "linear")
"""Delayed inputs on straight lines between samples; similar to held ones with another delay."""


def unusual_parts(structure: ArmStructure) -> list[Unusual]:
    """Return unusual terms that a structure lacks, and delays of the inputs and of each link.

    Delays of all links are also tried at once: if all are late, one delay alone may fit no better.
    """
    balance, links = structure.joint.balance, link_delays(structure.joint.balance)
    terms = [name for name in balance.unusual if name in structure.fixed]
    moving = [link for joint, link in enumerate(links, 1) if joint not in structure.joint.resting]
    alone = [Unusual((name,)) for name in (*terms, INPUT, *links)]
    return [*alone, Unusual(tuple(moving))] if len(moving) > 1 else alone


def link_delays(balance: TorqueBalance) -> tuple[str, ...]:
    """Return the name of each link encoder's delay; motor encoders have none."""
    return tuple(f"{row.name}{DELAY}" for row in balance.rows[::2])


def promises(fitted: FittedArm, parts: Sequence[Unusual]) -> Iterator[tuple[float, Unusual]]:
    """Yield the weighted squares that one step with each part is predicted to reach, and the part.

    The fall that the step would bring without the part is not counted.
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
            sought = np.array([name in {*fitted.names, *part.names} for name in seen.names])
            information = reduced.information[np.ix_(sought, sought)]
            scale = np.sqrt(np.maximum(np.diag(information), 0.0))
            inverse, _ = scaled_inverse(information, scale)
            fall = float(score[sought] @ inverse @ score[sought])
            yield squares - fall + fitted.minimum.reduced.decrement, part


def likeliest(promised: Iterable[tuple[float, Unusual]]) -> tuple[float, Unusual]:
    """Return the part that promises most beyond the fall that it must bring."""
    return min(promised, key=lambda each: each[0] + each[1].least)


def not_in(structure: ArmStructure, parts: Sequence[Unusual]) -> list[Unusual]:
    """Return the parts with a parameter that is not fitted yet, or with another hold."""
    fitted = {*structure.timing.sought, *structure.joint.balance.coefficients}
    fitted -= structure.fixed.keys()
    return [part for part in parts if part.hold or not fitted.issuperset(part.names)]
