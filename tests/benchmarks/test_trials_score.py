"""Scores of blind trials, on records that are made up."""

from math import isnan

import pytest
from benchmarks.trials.score import Share, claims, score, scores

RIGHT = [2.0, 1.9, 2.1, "determined"]
WRONG = [2.1, 2.05, 2.15, "determined"]


def record(**changes):
    """A log's record: truth 2 for the link's inertia, 10 for the stiffness."""
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


def test_each_interval_is_counted_where_it_belongs():
    """Assert that kept, removed and delays are counted apart, removed ones against their truth."""
    found = score([record()])
    assert found.coverage["all"] == Share(4, 5)
    assert found.coverage["determined"] == Share(1, 1)
    assert found.coverage["core"] == Share(1, 1)
    assert found.coverage["removed"] == Share(1, 2)
    assert found.coverage["delay"] == Share(1, 1)
    assert found.core_determined == Share(1, 2)
    assert found.coverage["removed"].percent == 50.0


def test_a_delay_that_was_given_is_no_claim():
    """Assert that only delays that were sought count."""
    given = {"input_delay": [0.0, 0.0, 0.0, "given"], "link_delay": [1e-4, 5e-5, 2e-4, "found"]}
    assert score([record(delays=given)]).coverage["delay"] == Share(0, 1)


def test_intervals_of_one_log_miss_together():
    """Assert that the standard error counts logs, not intervals.

    Of two logs with four of five and all of five intervals, the share is 9/10, and each log is half
    an interval off it: sqrt(2 (1/2)^2 2/1)/10.
    """
    right = record(removed={"joint_damping": [0.1, -0.1, 0.2], "x": [0.1, -0.1, 0.2]})
    assert score([record(), right]).coverage_deviation == pytest.approx(1.0 / 10.0)
    assert score([right, right]).coverage_deviation == 0.0
    assert isnan(score([right]).coverage_deviation)


def test_an_angle_without_gravity_is_no_claim():
    """Assert that the angle counts only where there is gravity, and in rad."""
    assert "gravity_angle" not in {claim.name for claim in claims(record())}
    tilted = record(truth={"gravity_torque": 1.0, "gravity_angle": 8.9})
    (angle,) = [claim for claim in claims(tilted) if claim.name == "gravity_angle"]
    assert angle.error == pytest.approx(0.1)
    assert angle.holds
    assert not angle.confidently_wrong


@pytest.mark.parametrize(
    ("estimate", "expected"),
    [
        (WRONG, 1),
        ([2.01, 2.005, 2.015, "determined"], 0),  # less than one percent off
        ([2.1, 1.9, 2.3, "determined"], 0),  # inside
        ([2.1, 2.05, 2.15, "weak"], 0),  # not claimed to be determined
        ([float("nan"), float("nan"), float("nan"), "determined"], 0),
    ],
)
def test_confidently_wrong(estimate, expected):
    """Assert that wrong is determined, outside its interval, and more than one percent off."""
    found = score([record(estimates={"link_inertia": estimate}), record()])
    assert found.wrong == found.wrong_core == expected


def test_what_does_not_act_is_never_confidently_wrong_but_missed():
    """Assert that an absent friction that is claimed costs coverage alone."""
    claimed = record(estimates={"link_viscous_friction": [0.1, 0.05, 0.15, "determined"]})
    found = score([claimed])
    assert found.wrong == 0
    assert found.coverage["determined"] == Share(0, 1)


def test_other_parameters_are_no_core():
    """Assert that a wrong friction counts among all parameters and not among the core."""
    wrong = {"motor_offset_torque": [0.4, 0.38, 0.42, "determined"]}
    found = score([record(estimates=wrong)])
    assert (found.wrong_core, found.wrong) == (0, 1)


def test_errors_and_widths_beside_the_given_structure():
    """Assert that errors and widths are compared parameter by parameter."""
    given = {"link_inertia": [2.02, 1.98, 2.06, "determined"]}
    found = score([record(given=given, least_squares={"link_inertia": 1.0})])
    assert found.error.middle == 0.0
    assert found.given_error.largest == pytest.approx(0.01)
    assert found.least_squares_error.largest == 0.5
    assert found.sharpness == pytest.approx(0.2 / 0.08)
    assert isnan(score([record()]).sharpness)


def test_a_failed_log_counts_as_undetermined():
    """Assert that an error is a row: counted, and none of its parameters determined."""
    failed = {k: record()[k] for k in ("family", "seed", "in_class", "terms", "truth")}
    failed |= {"error": "RecordingError: no", "refused": True}
    found = score([failed, record()])
    assert (found.logs, found.failed, found.refused) == (2, 1, 1)
    assert found.core_determined == Share(1, 4)


def test_mistaken_choices():
    """Assert that both shapes of Coulomb friction are one, and mistakes go by name."""
    found = score([record(), record(chosen={"terms": ["gravity"], "hold": "zero"})])
    assert found.missed == {"gravity": 1, "motor_coulomb": 1}
    assert found.extra == {"link_viscous": 1}
    assert found.wrong_hold == 1


def test_failures_come_first():
    """Assert the order: the model class before the rest, then the family with more wrong logs."""
    wrong = {"link_inertia": WRONG}
    records = [
        record(family="good"),
        record(family="bad", estimates=wrong),
        record(family="outside", in_class=False, estimates=wrong),
    ]
    assert [one.family for one in scores(records)] == ["bad", "good", "outside"]
