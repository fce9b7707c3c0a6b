"""Torques in steps and moves from rest to rest are what they say they are."""

import numpy as np
import pytest
from benchmarks.trials.motions import Moves, draw_steps

RESONANCE = 20.0  # rad/s


def test_a_jolt_is_a_step_at_the_first_sample():
    """Assert that a jolted torque acts before zero and steps there, and that another is late."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        before, at_zero = draw_steps(rng, RESONANCE, -0.3, 8.0, jolted=True).at(
            np.array([-1e-9, 0.0])
        )
        assert abs(before) >= 0.3
        assert before * at_zero < 0.0
        late = draw_steps(rng, RESONANCE, -0.3, 8.0, jolted=False)
        assert 0.1 <= late.instants[0] <= 0.5
        assert late.at(np.array([-0.3, 0.0, 0.09])).tolist() == [0.0] * 3


@pytest.mark.parametrize("ramp", [0.0, 0.2, 0.5])
def test_a_move_ends_at_its_target_and_rests(ramp):
    """Assert positions at the ends of moves and between them."""
    moves = Moves(np.array([0.5, 2.0]), np.array([1.0, 0.5]), np.array([0.8, -0.4]), ramp)
    times = np.array([0.0, 0.5, 1.0, 1.5, 1.9, 2.25, 2.5, 7.0])
    expected = [0.0, 0.0, 0.4, 0.8, 0.8, 0.2, -0.4, -0.4]
    np.testing.assert_allclose(moves.at(times), expected, atol=1e-12)
    rest = moves.rate_at(np.array([0.2, 1.7, 3.0]))
    np.testing.assert_array_equal(rest, np.zeros(3))
    peak = 0.8 * (1.875 if ramp == 0.0 else 1.0 / (1.0 - ramp))
    assert moves.rate_at(np.array([1.0]))[0] == pytest.approx(peak)
