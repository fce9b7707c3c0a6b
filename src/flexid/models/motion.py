"""Types of joints, and their units: declarations have the units of a revolute joint."""

import re
from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias, get_args

JointType: TypeAlias = Literal["revolute", "prismatic"]
"""Motion of link and motor: they turn, or they slide."""

JOINT_TYPES: tuple[JointType, ...] = get_args(JointType)

_UNITS: Mapping[JointType, Mapping[str, str]] = {
    "revolute": {"rad/rad": "1"},
    "prismatic": {"rad/rad": "rad/m", "kg m^2": "kg", "N m": "N", "rad": "m"},
}


def unit_of(declared: str, joint: JointType) -> str:
    """Convert a declared unit to a type of joint; ``rad/rad`` means periods in 2π."""
    units = _UNITS[joint]
    return re.sub("|".join(map(re.escape, units)), lambda found: units[found[0]], declared)


def unit_of_channel(channel: str, types: Sequence[JointType]) -> str:
    """Return the unit of a position; with several joints, the channel ends with their number."""
    number = channel.rpartition("_")[2]
    return unit_of("rad", types[int(number) - 1 if number.isdigit() else 0])


FORCES = tuple(unit_of("N m", joint) for joint in JOINT_TYPES)
"""Units of an input that is a torque or a force; with others, inertias are known as ratios only."""
