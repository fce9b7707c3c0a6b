"""Physical parameters from lumped coefficients, and back."""

from functools import partial

import numpy as np
import pytest

from flexid.models.flexible_joint import (
    COEFFICIENT_UNITS,
    RIGID_TERMS,
    RIGID_UNITS,
    SHAPE_TERMS,
    TERMS,
    TIES,
    flexible_joint,
    rigid_joint,
)
from flexid.models.motion import unit_of
from flexid.models.physical import Quotient, difference, joint_coefficients, physical_parameters

TRUTH = {
    "gravity_torque": 5.0,
    "link_inertia": 1.3,
    "joint_stiffness": 100.0,
    "motor_inertia": 0.3,
    "motor_viscous_friction": 0.1,
    "total_inertia": 1.6,
}

OFF_ZERO = {
    **joint_coefficients(TRUTH),
    "theta1": 5.0 / 1.3 * np.cos(0.2),
    "theta_cosine": -5.0 / 1.3 * np.sin(0.2),
}
RIGID = {
    "gamma1": 5.0 / 1.6 * np.cos(0.3),
    "gamma_cosine": 5.0 / 1.6 * np.sin(0.3),
    "gamma_viscous": 0.1 / 1.6,
    "gamma_coulomb": 0.4 / 1.6,
    "gamma_offset": 0.05 / 1.6,
    "beta1": 1 / 1.6,
}
RATIOS = {
    **{f"{n}_per_link_inertia": TRUTH[n] / 1.3 for n in ("gravity_torque", "joint_stiffness")},
    **{f"{n}_per_motor_inertia": TRUTH[n] / 0.3 for n in ("gravity_torque", "joint_stiffness")},
    "link_inertia_per_motor_inertia": 1.3 / 0.3,
    "viscous_friction_per_motor_inertia": 0.1 / 0.3,
    "input_gain_per_motor_inertia": 1.0 / 0.3,
}
rigid = partial(physical_parameters, kind="rigid")


@pytest.mark.parametrize(
    ("coefficients", "table", "truth"),
    [
        (joint_coefficients(TRUTH), physical_parameters, TRUTH),
        (joint_coefficients(TRUTH), lambda c, **_: physical_parameters(c, False), RATIOS),
        # With an encoder's offset, gravity is a torque and an angle, for the rigid joint too.
        (OFF_ZERO, physical_parameters, TRUTH | {"gravity_angle": 0.2}),
        (
            RIGID,
            rigid,
            {"gravity_torque": 5.0, "gravity_angle": -0.3, "inertia": 1.6}
            | {"viscous_friction": 0.1, "coulomb_friction": 0.4, "offset_torque": 0.05},
        ),
    ],
)
def test_map_is_inverted(coefficients, table, truth):
    """Assert that physical parameters are recovered from their coefficients."""
    found = {p.name: p.value(coefficients) for p in table(coefficients, input_is_torque=True)}
    assert found == pytest.approx(truth, rel=1e-13)


def test_gradient_exists_where_a_coefficient_is_zero():
    """Assert that an absent friction has a derivative, although its logarithm has none."""
    coefficients = {**joint_coefficients(TRUTH), "alpha2": 0.0}
    table = {p.name: p for p in physical_parameters(coefficients, input_is_torque=True)}
    gradient = table["motor_viscous_friction"].gradient(coefficients, ["alpha2", "beta1"])
    np.testing.assert_allclose(gradient, [0.3, 0.0])


def test_every_coefficient_has_a_unit_and_a_meaning():
    """Assert that each coefficient of each term has a unit and enters some physical parameter."""
    system = flexible_joint(tuple(TERMS | SHAPE_TERMS))
    assert set(system.coefficients) == set(COEFFICIENT_UNITS)
    used = {c for p in physical_parameters(system.coefficients, True) for c in p.coefficients}
    # Tied coefficients follow from those of the motor's row.
    assert used | set(TIES) == set(system.coefficients)

    names = rigid_joint(RIGID_TERMS).coefficients
    assert set(names) == set(RIGID_UNITS)
    for input_is_torque in (True, False):
        used = {c for p in rigid(names, input_is_torque) for c in p.coefficients}
        assert used == set(names)


ARM = {"stiffness": 90.0, "inertia": 0.05, "moment": 0.2}
RATIO = Quotient("ratio", "1/s^2", "stiffness", {"inertia": 1.0, "moment": 0.8})
BY_DIRECTION = {**RIGID, "gamma_asymmetry": 0.02 / 1.6}


@pytest.mark.parametrize("input_is_torque", [True, False])
@pytest.mark.parametrize(
    ("coefficients", "table"),
    [
        (joint_coefficients(TRUTH), physical_parameters),
        (OFF_ZERO, physical_parameters),
        (RIGID, rigid),
        (BY_DIRECTION, rigid),
        (ARM, lambda *_: [RATIO]),
    ],
)
def test_gradients_are_those_that_differences_show(coefficients, table, input_is_torque):
    """Assert that the delta method's gradients are the derivatives of the map."""
    names = list(coefficients)
    for parameter in table(coefficients, input_is_torque):
        numeric = []
        for name in names:
            # Rounding and truncation each contribute 1e-10 of value over coefficient.
            step = 1e-5 * abs(coefficients[name])
            up = parameter.value({**coefficients, name: coefficients[name] + step})
            down = parameter.value({**coefficients, name: coefficients[name] - step})
            numeric.append((up - down) / (2 * step))
        gradient = parameter.gradient(coefficients, names)
        np.testing.assert_allclose(gradient, numeric, rtol=1e-7, atol=1e-8)


def test_friction_by_direction():
    """Assert that viscous and Coulomb friction by direction give the rigid joint's friction."""
    found = {p.name: p for p in rigid(BY_DIRECTION, input_is_torque=True)}
    for direction, v in (("forwards", 1.0), ("backwards", -1.0)):
        viscous = found[f"viscous_friction_{direction}"].value(BY_DIRECTION)
        coulomb = found[f"coulomb_friction_{direction}"].value(BY_DIRECTION)
        braking = 0.1 * v + 0.02 * abs(v) + 0.4 * v - 0.05
        assert v * (viscous + coulomb) == pytest.approx(braking, rel=1e-13)
    assert "coulomb_friction_forwards" not in {p.name for p in rigid(RIGID, True)}


def test_an_angle_differs_by_the_shorter_way_round():
    """Assert that angles differ by at most half a turn, and other parameters by subtraction."""
    assert difference("gravity_angle", 3.1, -3.1) == pytest.approx(2.0 * np.pi - 6.2)
    assert difference("gravity_torque", 3.0, -3.0) == -6.0


def test_a_prismatic_joint_has_newtons_kilograms_and_metres():
    """Assert that revolute units are kept, or converted for a prismatic joint."""
    assert unit_of("N m s/rad", "revolute") == "N m s/rad"
    assert unit_of("N m s/rad", "prismatic") == "N s/m"
    assert unit_of("kg m^2", "prismatic") == "kg"
    assert unit_of("rad/rad", "revolute") == "1"
