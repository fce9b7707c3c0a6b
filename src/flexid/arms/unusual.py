"""Terms and delays of an arm that are fitted only if they help.

They are cubic springs, Stribeck friction and late channels.

One pass over the log predicts the gain of all of them, from a quadratic approximation about the
current fit.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np

from flexid.estimators.channel_timing import DELAY, INPUT
from flexid.estimators.normal_equations import scaled_inverse
from flexid.identification.full_model.fitting import expanded
from flexid.identification.full_model.model import Fitted, Structure
from flexid.identification.preparation.joint import ElasticArm
from flexid.models.flexible_joint import COULOMB_VELOCITY
from flexid.models.planar_arm import STRIBECK_CONSTANTS
from flexid.models.torque_balance import TorqueBalance
from flexid.recording.recording import Hold

UNUSUAL_FALL = 25.0
"""Fall of the weighted squares, over their variance, that each unusual parameter must bring."""

STRIBECK = "motor_stribeck_friction"
"""Name of a parameter, without the joint's number."""

# Velocities over which friction falls off its static value, over those that smooth dry friction.
_FALLS = np.geomspace(0.2, 8.0, 7)
_LAWS = (2.0, 1.0)  # exponents

FittedArm = Fitted[ElasticArm]
ArmStructure = Structure[ElasticArm]


@dataclass(frozen=True)
class Unusual:
    """Parameters that may be fitted in addition: of an unusual term, or delays of channels."""

    names: tuple[str, ...]
    hold: Hold | None = None  # how the inputs behave between samples; None keeps it
    constants: Mapping[str, float] = field(default_factory=dict)  # of an unusual term, by name

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
        balance = structure.joint.balance
        balance = replace(balance, constants={**balance.constants, **self.constants})
        joint = replace(structure.joint, balance=balance)
        return replace(structure, joint=joint, fixed=fixed, timing=timing)

    def is_possible(self, values: Mapping[str, float]) -> bool:
        """Whether no friction of these parameters is negative."""
        return all(values[name] >= 0.0 for name in self.names if "friction" in name)


LINES = Unusual((INPUT,), "linear")
"""Delayed inputs on straight lines between samples; similar to held ones with another delay."""


def unusual_parts(structure: ArmStructure) -> list[Unusual]:
    """Return unusual terms that a structure lacks, and delays of the inputs and of each encoder.

    Delays of all links are also tried at once: if all are late, one delay alone may fit no better.
    """
    balance, resting = structure.joint.balance, structure.joint.resting
    terms = [name for name in balance.unusual if name in structure.fixed]
    delays = encoder_delays(balance)
    alone = [Unusual((name,)) for name in (*terms, INPUT, *delays) if STRIBECK not in name]
    for joint, joint_type in enumerate(balance.types, 1):
        name = f"{STRIBECK}_{joint}"
        if name in terms and joint not in resting:
            velocity, exponent = (f"{constant}_{joint}" for constant in STRIBECK_CONSTANTS)
            for fall, law in product(_FALLS, _LAWS):
                size = float(fall * COULOMB_VELOCITY[joint_type])
                alone.append(Unusual((name,), constants={velocity: size, exponent: law}))
    moving = [link for joint, link in enumerate(delays[::2], 1) if joint not in resting]
    return [*alone, Unusual(tuple(moving))] if len(moving) > 1 else alone


def encoder_delays(balance: TorqueBalance) -> tuple[str, ...]:
    """Return the name of the delay of each encoder, in the order of the balance's rows."""
    return tuple(f"{row.name}{DELAY}" for row in balance.rows)


def promises(fitted: FittedArm, parts: Sequence[Unusual]) -> Iterator[tuple[float, Unusual]]:
    """Yield the weighted squares that one step with each part is predicted to reach, and the part.

    The fall that the step would bring without the part is not counted.
    """
    kinds = [_alike(part, fitted.structure.timing.hold) for part in parts]
    for kind in dict.fromkeys(kinds):
        own = [part for part, other in zip(parts, kinds, strict=True) if other == kind]
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
            step = inverse @ score[sought]
            values = dict(zip(np.array(seen.names)[sought].tolist(), step.tolist(), strict=True))
            fall = float(score[sought] @ step) if part.is_possible(values) else 0.0
            yield squares - fall + fitted.minimum.reduced.decrement, part


def _alike(part: Unusual, hold: Hold) -> tuple[Hold, tuple[float, ...]]:
    """Return the hold and constants of parts that one pass can try together."""
    return part.hold or hold, tuple(part.constants.values())


def likeliest(promised: Iterable[tuple[float, Unusual]]) -> tuple[float, Unusual]:
    """Return the part that promises most beyond the fall that it must bring."""
    return min(promised, key=lambda each: each[0] + each[1].least)


def not_in(structure: ArmStructure, parts: Sequence[Unusual]) -> list[Unusual]:
    """Return the parts with a parameter that is not fitted yet, or with another hold."""
    fitted = {*structure.timing.sought, *structure.joint.balance.coefficients}
    fitted -= structure.fixed.keys()
    return [part for part in parts if part.hold or not fitted.issuperset(part.names)]
