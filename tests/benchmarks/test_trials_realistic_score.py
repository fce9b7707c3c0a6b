"""Scores of realistic trials, on records that are made up."""

from math import isnan

import pytest
from benchmarks.trials.realistic.score import score, scores
from benchmarks.trials.score import Share

STANDARD_ERRORS = 1.959964  # to either side of a 95 % interval


def record(**changes):
    """A log's record: truth 2 for the link's inertia, 10 for the stiffness, none for an offset."""
    return {
        "family": "some",
        "seed": 0,
        "realistic": True,
        "core": ["link_inertia", "joint_stiffness"],
        "truth": {"link_inertia": 2.0, "joint_stiffness": 10.0, "gravity_torque": 0.0},
        "seconds": 2.0,
        "estimates": {
            "link_inertia": [2.02, 1.9, 2.1, "determined"],
            "joint_stiffness": [10.5, 9.0, 11.0, "weak"],
            "gravity_torque": [0.2, 0.1, 0.3, "determined"],
            "motor_offset_torque": [0.2, 0.1, 0.3, "determined"],
        },
    } | changes


def estimates(value, low, high):
    """One determined core parameter."""
    return {"estimates": {"link_inertia": [value, low, high, "determined"]}}


def test_only_determined_intervals_with_a_truth_count():
    """Assert that weak ones and those without a truth are left out, and that zero is a truth."""
    found = score("some", [record()])
    assert found.determined == Share(1, 2)
    assert found.core == Share(1, 1)
    assert found.core_determined == Share(1, 2)
    assert found.half_width == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("estimate", "expected"),
    [
        ((2.2, 2.15, 2.25), 1),
        ((2.06, 2.05, 2.07), 0),  # outside, but less than 5 % off
        ((2.2, 1.9, 2.5), 0),  # inside
    ],
)
def test_wrong_is_outside_and_five_percent_off(estimate, expected):
    """Assert that a log is wrong if a core value is outside its interval and 5 % off."""
    assert score("some", [record(**estimates(*estimate)), record()]).wrong == Share(expected, 2)


def test_the_error_ratio_is_one_for_honest_intervals():
    """Assert that normal errors with their standard errors give 1, and half of those give 2."""
    # the quartiles of a normal distribution: half the errors are smaller
    errors = [-1.5, -0.67449, 0.3, 0.67449]
    for share, ratio in ((1.0, 1.0), (0.5, 2.0)):
        half = 0.1 * STANDARD_ERRORS * share
        of_logs = [
            record(**estimates(2.0 + 0.1 * e, 2.0 + 0.1 * e - half, 2.0 + 0.1 * e + half))
            for e in errors
        ]
        assert score("some", of_logs).error_ratio == pytest.approx(ratio, rel=1e-4)


def test_a_failed_log_counts_as_undetermined():
    """Assert that an error leaves the core parameters of its log undetermined."""
    failed = {name: record()[name] for name in ("family", "seed", "realistic", "core", "truth")}
    found = score("some", [failed | {"error": "RecordingError: no", "refused": True}, record()])
    assert (found.logs, found.failed, found.refused) == (2, 1, 1)
    assert found.core_determined == Share(1, 4)
    assert isnan(score("some", [failed | {"error": "x"}]).half_width)


def test_all_families_are_scored_together_too():
    """Assert that the last score is that of all logs."""
    found = scores([record(), record(family="other")])
    assert [one.family for one in found] == ["some", "other", "all"]
    assert found[-1].logs == 2
