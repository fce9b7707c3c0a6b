"""A spring that bends: another stiffness beyond some deflection, as catalogues of gears have it."""

import numpy as np

from flexid.identification.full_model.model import Data, Fitted, Structure
from flexid.identification.preparation.joint import Joint
from flexid.identification.structure.sought_shape import SoughtShape
from flexid.models.flexible_joint import BEND_DEFLECTION, SHAPE_TERMS

# Of the deflection's standard deviation; counted from its mean, which a preload moves.
_TRIED = (0.0, 0.3, 0.5, 0.7, 1.0, 1.4, 2.0)
_BETWEEN = 0.4
_LEAST = 0.2  # a bend at less passes for friction

_SPRINGS = (("theta2", "theta_bend"), ("alpha1", "alpha_bend"))  # below the bend, and what joins
_SLACK = 0.01  # of the stiffness beyond the bend: of what is so soft below it nothing is known


def _deflection(joint: Joint, data: Data) -> tuple[float, float]:
    """Mean of the deflection, and its standard deviation, in rad."""
    sides = (joint.both_sides(recording)[0] for recording in data.samples)
    every = np.concatenate([np.subtract(*positions.T) for positions in sides])
    return float(np.mean(every)), float(np.std(every))


def resolution(joint: Joint, data: Data) -> float:
    """Difference of two deflections at which a spring may bend, in rad."""
    return _BETWEEN * _deflection(joint, data)[1]


def deflections(structure: Structure, data: Data) -> list[float]:
    """Deflections at which the spring may bend, in rad."""
    mean, usual = _deflection(structure.joint, data)
    if not usual > 0.0:
        return []
    tried = {abs(mean) + way * share * usual for share in _TRIED for way in (-1.0, 1.0)}
    return sorted(deflection for deflection in tried if deflection >= _LEAST * usual)


_TERM = SHAPE_TERMS["bent_spring"]

BEND = SoughtShape(
    "a spring that bends",
    frozenset({*_TERM.motor, *_TERM.link}),
    BEND_DEFLECTION,
    deflections,
    resolution,
)
"""A bent spring, and the deflection at which it bends."""


def is_slack(fitted: Fitted) -> bool:
    """Whether a bent spring has hardly any stiffness below its bend, as one with play has."""
    values = {**fitted.structure.fixed, **fitted.by_name}
    springs = [(values.get(below), values.get(more)) for below, more in _SPRINGS]
    known = [(below, more) for below, more in springs if below is not None and more is not None]
    return bool(known) and all(below <= _SLACK * (below + more) for below, more in known)
