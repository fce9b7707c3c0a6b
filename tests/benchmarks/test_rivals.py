"""What other tools get of a trial, how they are scored, and what the page says of it."""

from math import inf

import numpy as np
import pytest
from benchmarks.page_block import block_of
from benchmarks.rivals.__main__ import merged
from benchmarks.rivals.given import Answer, given
from benchmarks.rivals.page import BLOCK, PAGE, RESULTS, render
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


def test_a_smooth_torque_is_smooth_and_late():
    """Assert that a torque that runs on is integrated as the curve that it is."""
    made = given(trial("smooth", 0.003, 0.0))
    (mean,) = made.mean_torque(np.array([6.0, 6.1]))
    expected = (np.sin(7.0 * 6.097) - np.sin(7.0 * 5.997)) / 0.7
    assert mean == pytest.approx(expected, abs=1e-9)


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


def results(*records: dict) -> dict:
    """Results of one tool on one family."""
    about = {"tool": "mujoco", "family": "basic"}
    run = {"command": "this", "date": "2000-01-01", "commit": "abc", "machine": "one"}
    return {
        "runs": [run | {"python": "3"}],
        "versions": {"mujoco": "1.0"},
        "records": [about | {"seed": seed} | r for seed, r in enumerate(records)],
    }


def test_failures_stand_on_the_page():
    """Assert that a log without an answer, or with none that is a number, is not left out."""
    errors = {"link_inertia": -0.25, "motor_inertia": 0.1}
    inside = {"link_inertia": False, "motor_inertia": True}
    block = render(
        results(
            {"errors": errors, "inside": inside, "widest": 0.5, "seconds": 3.0},
            {"failed": "ValueError: no"},
            {"errors": {"link_inertia": inf}, "seconds": 5.0},
        )
    )
    assert "|MuJoCo sysid|0.25, failed, no number|" in block
    assert "|MuJoCo sysid|1/2 ±0.5|" in block
    assert "|MuJoCo sysid|4|" in block
    assert "- MuJoCo sysid, basic 1: ValueError: no" in block


def test_a_tool_without_intervals_says_so():
    """Assert that no intervals are told from none that hold."""
    block = render(results({"errors": {"link_inertia": 1.0}, "seconds": 3.0}))
    assert "|MuJoCo sysid|gives none|" in block


def test_a_later_record_counts():
    """Assert that a tool which ran again on a log has its later answer, beside all others."""
    old = results({"failed": "once"}, {"errors": {"link_inertia": 1.0}, "seconds": 3.0})
    together = merged(old, results({"errors": {"link_inertia": 2.0}, "seconds": 3.0}))
    assert [r["errors"]["link_inertia"] for r in together["records"]] == [2.0, 1.0]
    assert len(together["runs"]) == 2


def test_the_page_shows_the_results():
    """Assert that the tables are those of the stored results."""
    import json

    stored = json.loads(RESULTS.read_text(encoding="utf-8"))
    assert block_of(PAGE.read_text(encoding="utf-8"), BLOCK) == render(stored)
