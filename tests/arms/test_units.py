"""Units of an arm's parameters."""

from __future__ import annotations

import pytest

from flexid.arms.units import ArmUnits
from flexid.models.motion import JointType
from flexid.models.planar_arm import PlanarArm, planar_arm

TURNS: JointType = "revolute"
SLIDES: JointType = "prismatic"

Case = tuple[tuple[JointType, JointType], tuple[str, str], str]

# Stiffness of joint 1; stiffness, damping, inertia or mass, and constant of joint 2.
UNITS: dict[str, Case] = {
    "all in torques": ((TURNS, TURNS), ("N m", "N m"), "N m/rad N m/rad N m s/rad kg m^2 N m/N m"),
    "a force": ((TURNS, SLIDES), ("N m", "N"), "N m/rad N/m N s/m kg N/N"),
    "one current": ((TURNS, SLIDES), ("N m", "A"), "N m/rad N/m N s/m kg N/A"),
    "currents": ((TURNS, TURNS), ("A", "V"), "A/rad A/rad A s/rad A s^2/rad A/V"),
    "a slide last": ((TURNS, SLIDES), ("A", "A"), "A/rad A/m^2 A s/m^2 A s^2/m^2 A/(m A)"),
    "a slide first": ((SLIDES, TURNS), ("A", "A"), "A/m A m/rad A m s/rad A m s^2/rad A m/A"),
}


@pytest.mark.parametrize("case", UNITS)
def test_units_where_torques_are_known_or_not(case: str):
    """Assert that units follow from the types and inputs of the joints."""
    types, inputs, wanted = UNITS[case]
    slides = tuple(0.0 if way == SLIDES else None for way in types)
    terms = planar_arm(PlanarArm((0.3, 0.3), slides=slides)).placed()
    units = ArmUnits(types, inputs)
    found = {name: units.of(term, joint) for name, joint, term in terms}
    carried = "link_mass_2" if types[1] == SLIDES else "link_inertia_2"
    names = ("joint_stiffness_1", "joint_stiffness_2", "joint_damping_2", carried)
    assert " ".join(found[name] for name in (*names, "torque_constant_2")) == wanted
