"""A stream that is watched, as a chart."""

from __future__ import annotations

import numpy as np

from flexid.report.charts.description import Band, Level, Line
from flexid.report.charts.document import chart_document
from flexid.report.live_chart import Moment, live_chart

INFINITE = float("inf")


def moments(count: int) -> list[Moment]:
    """Return a stiffness whose first value is far off and whose interval narrows."""
    found = [Moment(0.0, {"joint_stiffness": (1e6, -INFINITE, INFINITE)}, {"link": INFINITE})]
    for place in range(1, count):
        half = 10.0 / place
        found.append(
            Moment(
                0.5 * place,
                {"joint_stiffness": (100.0, 100.0 - half, 100.0 + half)},
                {"link": 3.0},
            )
        )
    return found


def test_a_panel_for_each_parameter_and_one_for_the_excitation():
    """Assert that estimate, interval and true value are there, and no bounds are a gap."""
    chart = live_chart(moments(40), {"joint_stiffness": "N m/rad"}, {"joint_stiffness": 101.0})
    stiffness, excitation = chart.panels
    assert stiffness.y.unit == "N m/rad"
    band, line, level = stiffness.marks
    assert isinstance(band, Band)
    assert isinstance(line, Line)
    assert isinstance(level, Level)
    assert level.value == 101.0
    assert np.isnan(band.low[0])
    assert np.isnan(band.high[0])
    assert band.high[1] == 110.0
    assert excitation.y.logarithmic
    assert np.isnan(excitation.marks[-1].y[0])  # type: ignore[union-attr]


def test_a_wild_beginning_does_not_flatten_the_rest():
    """Assert that the frame holds the truth and what is usual, and leaves the first value out."""
    chart = live_chart(moments(40), {}, {"joint_stiffness": 110.0})
    limits = chart.panels[0].y.limits
    assert limits is not None
    assert 50.0 < limits[0] < 99.0
    assert 110.0 < limits[1] < 200.0


def test_one_moment_is_a_chart():
    """Assert that the first moment, without bounds, is drawn and can be sent."""
    found = live_chart(moments(1), {})
    assert chart_document(found)["name"] == "live"
    assert found.panels[0].x.limits == (0.0, 1.0)
    nothing = [Moment(0.0, {"joint_stiffness": (np.nan, np.nan, np.nan)}, {})]
    assert live_chart(nothing, {}).panels[0].y.limits is None
