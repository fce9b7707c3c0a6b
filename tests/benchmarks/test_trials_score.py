"""Scores of blind and realistic trials on synthetic records, and the data given to other tools."""

from math import isnan

import numpy as np
import pytest
from benchmarks.rivals.given import Answer, given
from benchmarks.rivals.tools import score as rival_score
from benchmarks.trials.generate import Trial
from benchmarks.trials.realistic import score as realistic
from benchmarks.trials.score import Share, score

RIGHT = [2.0, 1.9, 2.1, "determined"]
KNOWN = ("family", "seed", "in_class", "terms", "truth", "core", "realistic")
FAILED = {"error": "RecordingError: no", "refused": True}


def record(**changes):
    """Return a log's record; the true link inertia is 2, and the stiffness 10."""
    return {
        "family": "some",
        "seed": 0,
        "in_class": True,
        "hold": "zero",
        "terms": ["gravity", "motor_coulomb"],
        "truth": {"link_inertia": 2.0, "joint_stiffness": 10.0, "motor_offset_torque": 0.3},
        "seconds": 2.0,
        "estimates": {
            "link_inertia": RIGHT,
            "joint_stiffness": [10.5, 9.0, 11.0, "weak"],
            "gravity_angle": [9.0, 8.0, 10.0, "determined"],
        },
        "removed": {"motor_offset_torque": [0.1, -0.1, 0.2], "joint_damping": [0.1, -0.1, 0.2]},
        "delays": {"input_delay": [0.0, -1e-4, 1e-4, "none"]},
        "chosen": {"terms": ["motor_coulomb", "link_viscous"], "hold": "linear"},
    } | changes


def failed(one):
    """Return the record of a log that was refused."""
    return {name: one[name] for name in KNOWN if name in one} | FAILED


def test_each_interval_is_counted_where_it_belongs():
    """Assert that kept values, removed ones and delays are counted separately."""
    found = score([record()])
    shares = {"all": (4, 5), "determined": (1, 1), "core": (1, 1), "removed": (1, 2)}
    shares["delay"] = (1, 1)
    for name, (held, count) in shares.items():
        assert found.coverage[name] == Share(held, count)
    assert found.core_determined == Share(1, 2)
    assert found.coverage["removed"].percent == 50.0
    # Only unknown delays count.
    given = {"input_delay": [0.0, 0.0, 0.0, "given"], "link_delay": [1e-4, 5e-5, 2e-4, "found"]}
    assert score([record(delays=given)]).coverage["delay"] == Share(0, 1)


def test_a_failed_log_counts_as_undetermined():
    """Assert that a failed log is counted, with none of its parameters determined."""
    for found in (
        score([failed(record()), record()]),
        realistic.score("some", [failed(rig()), rig()]),
    ):
        assert (found.logs, found.failed, found.refused) == (2, 1, 1)
        assert found.core_determined == Share(1, 4)
    assert isnan(realistic.score("some", [failed(rig())]).half_width)


def rig(*estimate, **changes):
    """Return a realistic log's record, without gravity and with an offset of unknown truth."""
    estimates = {
        "link_inertia": [2.02, 1.9, 2.1, "determined"],
        "joint_stiffness": [10.5, 9.0, 11.0, "weak"],
        "gravity_torque": [0.2, 0.1, 0.3, "determined"],
        "motor_offset_torque": [0.2, 0.1, 0.3, "determined"],
    }
    if estimate:
        estimates = {"link_inertia": [*estimate, "determined"]}
    truth = {"link_inertia": 2.0, "joint_stiffness": 10.0, "gravity_torque": 0.0}
    core = ["link_inertia", "joint_stiffness"]
    return record(realistic=True, core=core, truth=truth, estimates=estimates) | changes


def test_only_determined_intervals_with_a_truth_count():
    """Assert that weak values and those without a truth are omitted, and that zero is a truth."""
    found = realistic.score("some", [rig()])
    assert found.determined == Share(1, 2)
    assert found.core == Share(1, 1)
    assert found.core_determined == Share(1, 2)
    assert found.half_width == pytest.approx(0.05)
    together = realistic.scores([rig(), rig(family="other")])
    assert [one.family for one in together] == ["some", "other", "all"]
    assert together[-1].logs == 2


@pytest.mark.parametrize(
    ("estimate", "expected"),
    [
        ((2.2, 2.15, 2.25), 1),
        ((2.06, 2.05, 2.07), 0),  # outside, but less than 5 % off
        ((2.2, 1.9, 2.5), 0),  # inside
    ],
)
def test_wrong_is_outside_and_five_percent_off(estimate, expected):
    """Assert that a realistic log is wrong if a value is outside its interval and 5 % off."""
    found = realistic.score("some", [rig(*estimate), rig()])
    assert found.wrong == Share(expected, 2)


@pytest.mark.parametrize(("share", "ratio"), [(1.0, 1.0), (0.5, 2.0)])
def test_the_error_ratio_is_one_for_honest_intervals(share, ratio):
    """Assert a ratio of 1 for right standard errors, and 2 for halved ones."""
    half = 0.1 * 1.959964 * share
    # The quartiles of a normal distribution contain half of the errors.
    values = [2.0 + 0.1 * error for error in (-1.5, -0.67449, 0.3, 0.67449)]
    of_logs = [rig(value, value - half, value + half) for value in values]
    assert realistic.score("some", of_logs).error_ratio == pytest.approx(ratio, rel=1e-4)


SAMPLE_TIME = 0.002  # s


def trial(hold: str, input_delay: float, link_delay: float) -> Trial:
    """Return a log of a swing with delays of the link's encoder and of the torque."""
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


def test_what_other_tools_are_given():
    """Assert an encoder shifted back to one clock, and a held torque with its delay."""
    made = given(trial("zero", 0.0, 0.0031))
    np.testing.assert_allclose(made.positions[:, 0], np.sin(3.0 * made.time), atol=1e-9)
    np.testing.assert_allclose(made.positions[:, 1], np.sin(3.0 * made.time), atol=1e-9)
    assert made.sample_time == pytest.approx(SAMPLE_TIME)
    made = given(trial("zero", 0.003, 0.0))
    # 3 ms late: the torque recorded at 5.996 s acts at 6.0005 s, and up to 6.001 s.
    (mean,) = made.mean_torque(np.array([6.0002, 6.0008]))
    assert mean == pytest.approx(np.cos(7.0 * 5.996), abs=1e-12)
    (across,) = made.mean_torque(np.array([6.0, 6.002]))
    assert across == pytest.approx(np.mean([np.cos(7.0 * 5.996), np.cos(7.0 * 5.998)]), abs=1e-12)


def test_scores_are_of_the_core():
    """Assert relative errors in per cent, and intervals only if an answer has them."""
    truth = {"gravity_torque": 0.0, "link_inertia": 2.0, "motor_inertia": 1.0}
    truth |= {"joint_stiffness": 50.0, "motor_viscous_friction": 0.1}
    values = {"link_inertia": 2.1, "motor_inertia": 0.5, "joint_stiffness": 50.0}
    assert rival_score(Answer(values), truth) == {
        "errors": {"link_inertia": 5.0, "motor_inertia": -50.0, "joint_stiffness": 0.0}
    }
    intervals = {"link_inertia": (1.9, 2.3), "motor_inertia": (0.4, 0.6)}
    found = rival_score(Answer(values, intervals | {"joint_stiffness": (49.0, 51.0)}), truth)
    assert found["inside"] == {
        "link_inertia": True,
        "motor_inertia": False,
        "joint_stiffness": True,
    }
    assert found["widest"] == 10.0
