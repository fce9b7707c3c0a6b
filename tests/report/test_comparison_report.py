"""A comparison as text within every width, as a chart, and on its page."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from flexid.comparisons.comparison import compare_estimates
from flexid.report.comparison import outcome_texts, parts
from flexid.report.comparison_summary import comparison_summary
from flexid.report.terminal import format_with_interval, laid_out
from made_estimates import STIFFER, drawn


@pytest.fixture(scope="module")
def comparison():
    """A drive before, and after, stiffer and with an offset that A does without."""
    rng = np.random.default_rng(21)
    a, b = drawn(rng), drawn(rng, {**STIFFER, "alpha_offset": 3.0}, hold="linear")
    offset = replace(b.parameters["motor_offset_torque"], value=0.001, interval=(-0.1, 0.1))
    return compare_estimates(
        replace(a, removed={offset.name: offset}), b, ("before.json", "after.json")
    )


@pytest.mark.parametrize("width", range(40, 201))
def test_it_fits_every_width(comparison, width):
    """Assert that each line fits, and that each value and each interval stands whole."""
    lines = [line.plain for line in laid_out(parts(comparison), width)]
    assert max(map(len, lines)) <= width
    page = " ".join(" ".join(lines).split())
    for d in comparison.parameters.values():
        low, high = d.percent_interval
        shown = [format_with_interval(d.percent, low, high, digits)[1:] for digits in (1, 2)]
        assert (
            any(f"[{lower}, {upper}] %" in page for lower, upper in shown) or d.name in NO_PERCENT
        )


NO_PERCENT = {"motor_offset_torque"}


def test_a_bound_promises_no_less_than_the_interval(comparison):
    """Assert that rounding makes no bound smaller than it is."""
    for d in comparison.parameters.values():
        if d.outcome == "no change":
            for text in outcome_texts(d):
                stated = float(re.findall(r"[\d.e+-]*\d", text)[0])
                largest = d.largest_percent if np.isfinite(d.largest_percent) else d.largest
                assert largest <= stated < 1.2 * largest


def test_what_may_hide_is_rounded_up(comparison):
    """Assert that the sentence promises no less than the interval."""
    d = replace(comparison.parameters["joint_stiffness"], outcome="no change")
    d = replace(d, percent_interval=(-1.0, 2.11))
    found = replace(comparison, parameters={d.name: d}, together=None)
    (line,) = comparison_summary(found)
    assert line.endswith("the largest that may hide is one of 2.2 % of joint_stiffness.")
