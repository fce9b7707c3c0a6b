"""The verdict on a number: where each of its rules begins and ends."""

from dataclasses import fields, replace

import numpy as np
import pytest

from flexid.identification.judgement import verdict
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds, table


def judged(half: float, value: float = 10.0, effect: float = np.inf) -> str:
    """Verdict on a value whose interval reaches so far to either side."""
    return verdict(value, (value - half, value + half), effect)[0]


@pytest.mark.parametrize(
    ("half", "expected", "words"),
    [
        (1.0, "determined", ""),
        (1.99, "determined", ""),
        (2.01, "weak", "20 %"),
        (9.99, "weak", "100 %"),
        (10.01, "undetermined", "100 %"),
        (50.0, "undetermined", "500 %"),
        (101.0, "undetermined", "far"),
    ],
)
@pytest.mark.parametrize("value", [10.0, -10.0])
def test_width_decides(value, half, expected, words):
    """Assert that a fifth of the value is determined and the whole weak, whatever its sign.

    The reason is empty where determined, and otherwise gives the width.
    """
    status, reason = verdict(value, (value - half, value + half))
    assert status == expected
    assert (reason == "") == (words == "")
    assert words in reason


@pytest.mark.parametrize(("effect", "expected"), [(0.039, "determined"), (0.041, "undetermined")])
@pytest.mark.parametrize("value", [0.0, 1e-6])
def test_what_does_nothing_is_determined(value, effect, expected):
    """Assert that a number is known to be small if it moves its row by less than a 25th."""
    assert judged(1.0, value, effect) == expected


def test_what_else_counts():
    """Assert that effect does not spoil a narrow interval, and that zero has no relative width.

    An interval that is longer above is judged by half its whole width; one without an end says that
    there is no information.
    """
    assert judged(1.9, effect=1.0) == "determined"
    assert judged(1e-12, 0.0) == "undetermined"
    assert verdict(10.0, (9.0, 12.9))[0] == "determined"
    assert verdict(10.0, (9.0, 13.1))[0] == "weak"
    for ends in ((-np.inf, np.inf), (0.0, np.inf)):
        status, reason = verdict(1.0, ends, effect=0.0)
        assert status == "undetermined"
        assert "no information" in reason


def test_other_thresholds_judge_otherwise():
    """Assert that verdicts follow the thresholds that are given, each of the three."""
    strict = replace(THRESHOLDS, determined_width=0.1)
    assert verdict(10.0, (8.5, 11.5), thresholds=strict)[0] == "weak"
    assert verdict(10.0, (5.0, 15.0), thresholds=replace(strict, weak_width=0.4))[0] == (
        "undetermined"
    )
    loose = replace(THRESHOLDS, negligible_share=0.5)
    assert verdict(0.0, (-1.0, 1.0), 0.4, loose)[0] == "determined"


def test_table_lists_every_threshold():
    """Assert that each threshold stands in the table with a unit and a reason."""
    rows = table(replace(THRESHOLDS, weak_width=0.7))
    assert [row[0] for row in rows] == [f.name for f in fields(Thresholds)]
    assert {row[0]: row[1] for row in rows}["weak_width"] == 0.7
    assert all(unit and reason for _, _, unit, reason in rows)
