"""The chart of a comparison: both values with their intervals, relative to A's."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import flexid
from flexid.comparisons.comparison import compare_estimates
from flexid.report.chart import Line, Points
from flexid.report.comparison import charts
from made_estimates import STIFFER, TRUE, exact, with_parameter


def marks(panel, kind):
    """Marks of one kind, A's before B's."""
    return [mark for mark in panel.marks if isinstance(mark, kind)]


def test_values_and_intervals_stand_side_by_side():
    """Assert that each panel has A about zero, and B as many per cent away as it differs."""
    a, b = exact(TRUE, "a"), exact(STIFFER, "b")
    (chart,) = charts(compare_estimates(a, b))
    assert [panel.title.partition("\n")[0] for panel in chart.panels] == [*a.parameters]
    for panel, name in zip(chart.panels, a.parameters, strict=True):
        of_a, of_b = (e.parameters[name] for e in (a, b))
        points, lines = marks(panel, Points), marks(panel, Line)
        assert [point.y.item() for point in points] == [0.0, 1.0]
        assert points[0].x.item() == 0.0
        assert points[1].x.item() == pytest.approx(100.0 * (of_b.value / of_a.value - 1.0))
        for line, value in zip(lines, (of_a, of_b), strict=True):
            ends = 100.0 * (np.array(value.interval) / of_a.value - 1.0)
            np.testing.assert_allclose(line.x, ends, atol=1e-9)
    stiffness = chart.panels[[*a.parameters].index("joint_stiffness")]
    assert stiffness.title == "joint_stiffness\nchanged"
    assert stiffness.x.unit == "%"


def test_what_may_be_zero_has_its_unit():
    """Assert that no percentage is drawn where A's value may be zero."""
    a, b = (exact({**TRUE, "alpha_offset": value}, str(value)) for value in (1.0, 0.5))
    a = with_parameter(a, "motor_offset_torque", value=0.1, std=0.25, interval=(-0.4, 0.6))
    (chart,) = charts(compare_estimates(a, b))
    (panel,) = [panel for panel in chart.panels if panel.title.startswith("motor_offset_torque")]
    assert panel.x.unit == "N m"


def test_the_library_draws_it():
    """Assert that a comparison has a figure."""
    a, b = (flexid.JointEstimate(exact(true, log)) for true, log in ((TRUE, "a"), (STIFFER, "b")))
    assert isinstance(flexid.compare(a, b).plot(), Figure)
