"""How a joint moves, and the units that follow: all is declared of a revolute joint."""

import re
from collections.abc import Mapping, Sequence
from typing import Literal, TypeAlias, get_args

JointType: TypeAlias = Literal["revolute", "prismatic"]
"""How link and motor move: they turn, or they slide."""

JOINT_TYPES: tuple[JointType, ...] = get_args(JointType)

_UNITS: Mapping[JointType, Mapping[str, str]] = {
    "revolute": {"rad/rad": "1"},
    "prismatic": {"rad/rad": "rad/m", "kg m^2": "kg", "N m": "N", "rad": "m"},
}


def unit_of(declared: str, joint: JointType) -> str:
    """The unit of a joint in place of a declared one; ``rad/rad`` stands for periods in 2π."""
    units = _UNITS[joint]
    return re.sub("|".join(map(re.escape, units)), lambda found: units[found[0]], declared)


def unit_of_channel(channel: str, types: Sequence[JointType]) -> str:
    """The unit of a position by how its joint moves, which has a number where there are several."""
    number = channel.rpartition("_")[2]
    return unit_of("rad", types[int(number) - 1 if number.isdigit() else 0])


FORCES = tuple(unit_of("N m", joint) for joint in JOINT_TYPES)
"""Units of an input that is a torque or a force: of another one, inertias are ratios only."""
