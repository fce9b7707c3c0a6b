"""Readings of the printed feedback gains: poles, tracking, parameter errors."""

import numpy as np
import pytest

from flexid.studies.readings import SIMULATED, closed_loop_poles

ERRORS = {
    "1,2,3": {"theta1": 0.168536, "theta2": -0.225358, "alpha1": -1.542909, "alpha2": 0.113534},
    "1,1,3": {"theta1": -4.38e-4, "theta2": -2.53e-5, "alpha1": 0.0, "alpha2": 0.0},
}
"""Parameter errors at 30 s, found by two other formulations with SciPy's Radau."""


@pytest.mark.parametrize(
    ("exponents", "largest"),
    [((1, 1, 0), 13.8), ((1, 1, 1), 22.7), ((1, 1, 3), 0.011), ((1, 2, 3), -60.0)],
)
def test_largest_real_part_of_the_poles(exponents, largest):
    """Assert the largest real part in 1/s that the derived Jacobian gives each reading."""
    assert closed_loop_poles(exponents).real.max() == pytest.approx(largest, rel=5e-3, abs=5e-4)


def test_poles_are_those_of_the_plant_written_by_hand():
    """Assert that the derived loop has the poles of eq. (4) under u_F in plain coordinates."""
    k, first, second, third = 50.0, 50 * 1.4 / 60, 50.0**2, 50.0**3 * 0.42
    # u_F = -third (x4 + second (x3 + first (x2 + k x1))) at qd = 0, linearised.
    u = -third * np.array([second * first * k, second * first, second, 1.0])
    plant = np.array(
        [[0, 1, 0, 0], [-5 - 100, 0, 100, 0], [0, 0, 0, 1], [100 / 0.3, 0, -100 / 0.3, -0.1 / 0.3]]
    )
    plant[3] += u / 0.3
    expected = np.sort_complex(np.linalg.eigvals(plant))
    np.testing.assert_allclose(np.sort_complex(closed_loop_poles((1, 2, 3))), expected, rtol=1e-6)


def test_smallest_edit_rings_at_77_rad_per_second(reproduction):
    """Assert that gains (1,1,3) leave an undamped pair at 77 rad/s."""
    assert abs(reproduction.readings["1,1,3"].rightmost.imag) == pytest.approx(77.0, abs=0.5)


@pytest.mark.parametrize("reading", ERRORS)
def test_parameter_errors_at_30_s(reproduction, reading):
    """Assert that the errors agree with the published digits to 1e-5, where that is meaningful."""
    found = reproduction.runs[reading].parameter_errors
    assert found == pytest.approx(ERRORS[reading], rel=1e-5, abs=1e-6)


@pytest.mark.parametrize(("reading", "expected"), [("1,2,3", 8.187e-4), ("1,1,3", 0.272)])
def test_largest_tracking_error_from_20_to_30_s(reproduction, reading, expected):
    """Assert the steady tracking error in rad of each reading that stays bounded for 30 s."""
    found = reproduction.runs[reading].max_tracking_error
    assert found == pytest.approx(expected, rel=2e-4)


def test_tracking_error_of_the_smallest_edit_keeps_growing(reproduction):
    """Assert that under (1,1,3) it passes 0.37 rad by 60 s and 0.7 rad by 120 s: no bound."""
    late = reproduction.late_tracking_errors
    assert late[60.0] == pytest.approx(0.38, abs=0.005)
    assert late[120.0] > 0.7


@pytest.mark.parametrize(("reading", "velocity"), [("1,1,3", 1.2e3), ("1,2,3", 4.2e4)])
def test_peaks_are_unphysical(reproduction, reading, velocity):
    """Assert the motor velocity in rad/s that Table I's jump of the reference asks for."""
    assert reproduction.runs[reading].peak_motor_velocity == pytest.approx(velocity, rel=0.03)


@pytest.mark.parametrize("reading", ["1,1,0", "1,1,1"])
def test_unstable_readings_leave_the_reference_at_once(reproduction, reading):
    """Assert that the literal readings are whole turns off the reference within 0.3 s."""
    assert reproduction.readings[reading].early_tracking_error > 2 * np.pi
    assert reproduction.readings[reading].simulated is None


def test_larger_k_shrinks_the_tracking_error_of_increasing_gains(reproduction):
    """Assert that under (1,2,3) the error falls with the square of k from 15 to 1000."""
    points = reproduction.attenuation["1,2,3"]
    product = np.array([point.max_tracking_error * point.k**2 for point in points])
    assert product.max() / product.min() < 1.2
    assert points[-1].k == 1000.0


def test_simulated_readings_are_the_two_of_the_figures(reproduction):
    """Assert that runs of 30 s exist for (1,2,3) and (1,1,3), in this order."""
    assert list(reproduction.runs) == ["1,2,3", "1,1,3"]
    assert SIMULATED == ((1, 2, 3), (1, 1, 3))
