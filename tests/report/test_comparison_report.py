"""Bounds of a comparison as text."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from flexid.report.comparison import comparison_summary, largest, outcome_text
from flexid.stored_estimates.comparison import compare_estimates
from made_estimates import STIFFER, drawn


@pytest.fixture(scope="module")
def comparison():
    """A drive before, and after, stiffer and with an offset that A does without."""
    rng = np.random.default_rng(21)
    a, b = drawn(rng), drawn(rng, {**STIFFER, "alpha_offset": 3.0}, hold="linear")
    offset = replace(b.parameters["motor_offset_torque"], value=0.001, interval=(-0.1, 0.1))
    return compare_estimates(replace(a, removed={offset.name: offset}), b)


def test_a_bound_promises_no_less_than_the_interval(comparison):
    """Assert that rounding makes no bound smaller than it is."""
    for d in comparison.parameters.values():
        if d.outcome == "no change":
            stated = float(re.findall(r"[\d.e+-]*\d", outcome_text(d).plain)[0])
            largest = d.largest_percent if np.isfinite(d.largest_percent) else d.largest
            assert largest <= stated < 1.2 * largest


def test_what_may_hide_is_told(comparison):
    """Assert that an interval beyond the value's own size is no agreement, and ends round up."""
    d = replace(comparison.parameters["joint_stiffness"], outcome="no change")
    assert outcome_text(replace(d, percent_interval=(-700.0, 101.0))).plain == "cannot tell"
    assert outcome_text(replace(d, percent_interval=(-99.0, 5.0))).plain == "same to 99 %"
    d = replace(d, percent_interval=(-1.0, 2.11))
    (line,) = comparison_summary(replace(comparison, parameters={d.name: d}))
    assert line.endswith("the largest that may hide is one of 2.2 % of joint_stiffness.")


def test_a_bound_without_a_share_has_its_unit(comparison):
    """Assert that it is the farther end, rounded up, where the values are next to nothing."""
    d = replace(
        comparison.parameters["motor_offset_torque"],
        interval=(-0.1, 0.0512),
        percent_interval=(np.nan, np.nan),
    )
    assert largest(d) == "0.1 N m"
    assert largest(replace(d, interval=(-0.1, 0.1512))) == "0.16 N m"
