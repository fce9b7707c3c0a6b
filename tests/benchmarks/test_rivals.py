"""What other tools get of a trial, and how they are scored."""

import numpy as np
import pytest
from benchmarks.rivals.given import Answer, given
from benchmarks.rivals.tools import score
from benchmarks.trials.generate import Trial

SAMPLE_TIME = 0.002  # s


def trial(hold: str, input_delay: float, link_delay: float) -> Trial:
    """A log of a swing, of which the link's encoder and the torque are late."""
    time = 5.0 + SAMPLE_TIME * np.arange(2000, dtype=np.float64)
    return Trial(
        "basic",
        0,
        time,
        link_position=np.sin(3.0 * (time - link_delay)),
        motor_position=np.sin(3.0 * time),
        torque=np.cos(7.0 * time),
        truth={"input_delay": input_delay, "link_delay": link_delay},
        terms=("gravity", "motor_viscous"),
        hold=hold,
        in_class=True,
        metadata={"sample_time": SAMPLE_TIME, "resonance": 20.0},
    )


def test_positions_are_on_one_clock():
    """Assert that a late encoder is put where it was, to what a cubic between samples leaves."""
    made = given(trial("zero", 0.0, 0.0031))
    np.testing.assert_allclose(made.positions[:, 0], np.sin(3.0 * made.time), atol=1e-9)
    np.testing.assert_allclose(made.positions[:, 1], np.sin(3.0 * made.time), atol=1e-9)
    assert made.sample_time == pytest.approx(SAMPLE_TIME)


def test_a_held_torque_is_held_and_late():
    """Assert that within a sample the torque that was recorded a delay before acts."""
    made = given(trial("zero", 0.003, 0.0))
    # 3 ms late: at 6.0005 s acts what was recorded at 5.996 s, and up to 6.001 s.
    (mean,) = made.mean_torque(np.array([6.0002, 6.0008]))
    assert mean == pytest.approx(np.cos(7.0 * 5.996), abs=1e-12)
    (across,) = made.mean_torque(np.array([6.0, 6.002]))
    assert across == pytest.approx(np.mean([np.cos(7.0 * 5.996), np.cos(7.0 * 5.998)]), abs=1e-12)


def test_scores_are_of_the_core():
    """Assert that errors are relative, and intervals count where they are stated."""
    truth = {"gravity_torque": 0.0, "link_inertia": 2.0, "motor_inertia": 1.0}
    truth |= {"joint_stiffness": 50.0, "motor_viscous_friction": 0.1}
    values = {"link_inertia": 2.1, "motor_inertia": 0.5, "joint_stiffness": 50.0}
    assert score(Answer(values), truth) == {
        "errors": {"link_inertia": 5.0, "motor_inertia": -50.0, "joint_stiffness": 0.0}
    }
    intervals = {"link_inertia": (1.9, 2.3), "motor_inertia": (0.4, 0.6)}
    found = score(Answer(values, intervals | {"joint_stiffness": (49.0, 51.0)}), truth)
    assert found["inside"] == {
        "link_inertia": True,
        "motor_inertia": False,
        "joint_stiffness": True,
    }
    assert found["widest"] == 10.0
