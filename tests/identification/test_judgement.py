"""The verdict on a number: where each of its rules begins and ends."""

from dataclasses import fields, replace

import numpy as np
import pytest

from flexid.identification.judgement.estimates import verdict
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds, table


def judged(half: float, value: float = 10.0, effect: float = np.inf) -> str:
    """Verdict on a value whose interval reaches so far to either side."""
    return verdict(value, (value - half, value + half), effect)[0]


@pytest.mark.parametrize(
    ("half", "expected"),
    [
        (1.99, "determined"),
        (2.01, "weak"),
        (9.99, "weak"),
        (10.01, "undetermined"),
        (1e9, "undetermined"),
    ],
)
@pytest.mark.parametrize("value", [10.0, -10.0])
def test_width_decides(value, half, expected):
    """Assert that a fifth of the value is determined and the whole weak, whatever its sign."""
    assert judged(half, value) == expected


@pytest.mark.parametrize(("effect", "expected"), [(0.039, "determined"), (0.041, "undetermined")])
@pytest.mark.parametrize("value", [0.0, 1e-6])
def test_what_does_nothing_is_determined(value, effect, expected):
    """Assert that a number is known to be small if it moves its row by less than a 25th."""
    assert judged(1.0, value, effect) == expected


def test_effect_does_not_spoil_a_narrow_interval():
    """Assert that a number known to a fifth is determined however much it does."""
    assert judged(1.9, effect=1.0) == "determined"


def test_zero_with_a_width_is_undetermined():
    """Assert that a value of zero has no relative width that could be small."""
    assert judged(1e-12, 0.0) == "undetermined"


@pytest.mark.parametrize("ends", [(-np.inf, np.inf), (0.0, np.inf)])
def test_whole_line_is_undetermined_whatever_it_does(ends):
    """Assert that an interval without an end says that there is no information."""
    status, reason = verdict(1.0, ends, effect=0.0)
    assert status == "undetermined"
    assert "no information" in reason


def test_interval_on_the_logarithm_counts_by_half_its_width():
    """Assert that an interval that is longer above is judged by half its whole width."""
    assert verdict(10.0, (9.0, 12.9))[0] == "determined"
    assert verdict(10.0, (9.0, 13.1))[0] == "weak"


@pytest.mark.parametrize(
    ("half", "words"), [(1.0, ""), (3.4, "34 %"), (50.0, "500 %"), (101.0, "far")]
)
def test_reason_gives_the_width(half, words):
    """Assert that the reason is empty where determined, and otherwise tells the width."""
    reason = verdict(10.0, (10.0 - half, 10.0 + half))[1]
    assert (reason == "") == (words == "")
    assert words in reason


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
