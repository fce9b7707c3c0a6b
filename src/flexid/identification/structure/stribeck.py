"""Friction that falls off its static value as the motor moves: the velocity at which it does."""

import numpy as np

from flexid.identification.full_model.model import Data, Structure
from flexid.identification.preparation.joint import Joint
from flexid.identification.structure.sought_shape import SoughtShape
from flexid.models.flexible_joint import SHAPE_TERMS, STRIBECK_VELOCITY

_MOTOR = 1  # row
_TRIED = (0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)  # of the velocity's root mean square
_BETWEEN = 0.8  # of a Stribeck velocity, to the next one that the data distinguish at a glance


def resolution(joint: Joint, _: Data) -> float:
    """Difference of two Stribeck velocities, in rad/s: it grows with the velocity itself."""
    return _BETWEEN * joint.extended.constants[STRIBECK_VELOCITY]


def velocities(structure: Structure, data: Data) -> list[float]:
    """Velocities in rad/s over which static friction may fall off."""
    sides = (structure.joint.both_sides(recording)[1] for recording in data.samples)
    usual = float(np.sqrt(np.mean(np.concatenate([v[:, _MOTOR] for v in sides]) ** 2)))
    return [share * usual for share in _TRIED] if usual > 0.0 else []


STRIBECK = SoughtShape(
    "friction that falls off its static value",
    frozenset(SHAPE_TERMS["motor_stribeck"].motor),
    STRIBECK_VELOCITY,
    velocities,
    resolution,
)
"""Stribeck friction of the motor, and its velocity."""
