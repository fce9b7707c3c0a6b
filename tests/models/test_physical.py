"""Physical parameters from lumped coefficients, and back."""

import numpy as np
import pytest

from flexid.models.flexible_joint import COEFFICIENT_UNITS, TERMS, flexible_joint
from flexid.models.physical import lumped_coefficients, physical_parameters

TRUTH = {
    "gravity_torque": 5.0,
    "link_inertia": 1.3,
    "joint_stiffness": 100.0,
    "motor_inertia": 0.3,
    "motor_viscous_friction": 0.1,
}


def test_map_is_inverted():
    """Assert that physical parameters survive the way to coefficients and back."""
    coefficients = lumped_coefficients(**TRUTH)
    table = physical_parameters(coefficients, input_is_torque=True)
    assert {p.name: p.value(coefficients) for p in table} == pytest.approx(TRUTH, rel=1e-14)


@pytest.mark.parametrize("input_is_torque", [True, False])
def test_gradient_matches_finite_differences(input_is_torque):
    """Assert that the delta method's gradient is the derivative of the map."""
    coefficients = lumped_coefficients(**TRUTH)
    names = list(coefficients)
    for parameter in physical_parameters(names, input_is_torque):
        numeric = []
        for name in names:
            step = 1e-6 * coefficients[name]
            up = parameter.value({**coefficients, name: coefficients[name] + step})
            down = parameter.value({**coefficients, name: coefficients[name] - step})
            numeric.append((up - down) / (2 * step))
        np.testing.assert_allclose(
            parameter.gradient(coefficients, names), numeric, rtol=1e-7, atol=1e-12
        )


def test_gradient_exists_where_a_coefficient_is_zero():
    """Assert that an absent friction has a derivative although its logarithm has none."""
    coefficients = {**lumped_coefficients(**TRUTH), "alpha2": 0.0}
    table = {p.name: p for p in physical_parameters(coefficients, input_is_torque=True)}
    gradient = table["motor_viscous_friction"].gradient(coefficients, ["alpha2", "beta1"])
    np.testing.assert_allclose(gradient, [0.3, 0.0])


def test_voltage_gives_ratios_only():
    """Assert that nothing absolute is claimed when the input is no torque."""
    names = lumped_coefficients(**TRUTH)
    table = physical_parameters(names, input_is_torque=False)
    assert all("_per_" in p.name for p in table)
    coefficients = lumped_coefficients(**TRUTH)
    ratio = next(p for p in table if p.name == "link_inertia_per_motor_inertia")
    assert ratio.value(coefficients) == pytest.approx(1.3 / 0.3)


def test_every_coefficient_has_a_unit_and_a_meaning():
    """Assert that each coefficient of each term has a unit and enters some physical parameter."""
    system = flexible_joint(tuple(TERMS))
    assert set(system.coefficients) == set(COEFFICIENT_UNITS)
    used = {c for p in physical_parameters(system.coefficients, True) for c in p.exponents} | {
        "theta_damping",
        "theta_cubic",
    }  # the link's view of what the motor row already gives
    assert used == set(system.coefficients)
