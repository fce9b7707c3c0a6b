"""A drive that plays a torque or follows a reference."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexid.errors import SimulationError
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run
from flexid.simulation.played_run import Command, play

JOINT = flexible_joint()
TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
H, N = 0.002, 1001
TIME = H * np.arange(N)
NOTHING = np.zeros((N, 2))


def test_a_torque_is_played_as_it_is():
    """Assert that without a position loop the run is the free run under the held torque."""
    torque = 5.0 * np.sin(3.0 * TIME)
    states, inputs = play(JOINT, TRUE, np.zeros(4), Command(torque, NOTHING, np.zeros(2)), H)
    np.testing.assert_array_equal(inputs, torque)
    expected = free_run(JOINT, TRUE, np.zeros(4), torque, H, "zero")
    np.testing.assert_allclose(states, expected, atol=1e-9)


def test_position_loop_against_scipy():
    """Assert that a fast sampled loop moves as the continuous one that SciPy integrates."""
    gains = np.array([200.0, 15.0])
    reference = np.column_stack((np.sin(2.0 * TIME), 2.0 * np.cos(2.0 * TIME)))

    def rates(t, x):
        wanted = gains[0] * (np.sin(2 * t) - x[2]) + gains[1] * (2 * np.cos(2 * t) - x[3])
        twist = x[0] - x[2]
        link = -TRUE["theta1"] * np.sin(x[0]) - TRUE["theta2"] * twist
        motor = TRUE["alpha1"] * twist - TRUE["alpha2"] * x[3] + TRUE["beta1"] * wanted
        return [x[1], link, x[3], motor]

    states, _ = play(JOINT, TRUE, np.zeros(4), Command(np.zeros(N), reference, gains), H)
    exact = solve_ivp(rates, (0, TIME[-1]), np.zeros(4), t_eval=TIME, rtol=1e-10, atol=1e-12)
    assert np.abs(states[:, ::2] - exact.y.T[:, ::2]).max() < 0.02


def test_scaling_keeps_the_first_position():
    """Assert that a scaled reference starts where it did and moves in proportion."""
    reference = np.column_stack((0.5 + np.sin(TIME), np.cos(TIME)))
    scaled = Command(np.zeros(N), reference, np.ones(2)).scaled(0.5)
    assert scaled.reference[0, 0] == 0.5
    assert np.ptp(scaled.reference[:, 0]) == pytest.approx(0.5 * np.ptp(reference[:, 0]))


def test_a_run_that_runs_away():
    """Assert that a loop that is unstable is an error, not numbers without end."""
    command = Command(np.zeros(N), NOTHING + np.array([1.0, 0.0]), np.array([-1e4, -1e3]))
    with pytest.raises(SimulationError, match="beyond all bounds"):
        play(JOINT, TRUE, np.zeros(4), command, H)
