"""How a joint moves, and the units that follow.

Everything is declared of a revolute joint. A prismatic joint obeys the same equations with a metre
in place of a radian, a newton in place of a newton metre and a kilogram in place of a kilogram
square metre. Only what repeats with the angle of the link is absent.
"""

import re
from collections.abc import Mapping
from typing import Literal, TypeAlias, get_args

JointType: TypeAlias = Literal["revolute", "prismatic"]
"""How link and motor move: they turn, or they slide."""

JOINT_TYPES: tuple[JointType, ...] = get_args(JointType)

_UNITS: Mapping[JointType, Mapping[str, str]] = {
    "revolute": {"rad/rad": "1"},
    "prismatic": {"rad/rad": "rad/m", "kg m^2": "kg", "N m": "N", "rad": "m"},
}


def unit_of(declared: str, joint: JointType) -> str:
    """The unit that a joint has in place of a declared one; ``rad/rad`` stands for periods in 2π.

    >>> unit_of("N m s/rad", "revolute"), unit_of("N m s/rad", "prismatic")
    ('N m s/rad', 'N s/m')
    >>> unit_of("kg m^2", "prismatic"), unit_of("rad/rad", "revolute")
    ('kg', '1')
    """
    units = _UNITS[joint]
    return re.sub("|".join(map(re.escape, units)), lambda found: units[found[0]], declared)


FORCES = tuple(unit_of("N m", joint) for joint in JOINT_TYPES)
"""Units of an input that is a torque or a force: of another one, inertias are ratios only."""
