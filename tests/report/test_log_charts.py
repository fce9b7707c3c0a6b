"""A log as it was read, as a chart."""

from __future__ import annotations

import numpy as np

from flexid.recording.recording import Log, Recording
from flexid.report.chart import Line
from flexid.report.free_run_chart import log_chart


def recording(start: float, *, link: bool = True, drive: bool = True) -> Recording:
    """Return ten samples."""
    values = np.arange(10.0)
    return Recording(
        sample_time=0.1,
        start_time=start,
        link_position=2.0 * values if link else None,
        motor_position=values,
        input=-values if drive else None,
        input_unit="V" if drive else "",
    )


def test_gaps_are_gaps():
    """Assert that a line does not cross what is missing, and keeps every sample."""
    chart = log_chart(Log((recording(0.0), recording(5.0)), (), "log", ""))
    assert [panel.y.unit for panel in chart.panels] == ["rad", "rad", "V"]
    line = chart.panels[1].marks[0]
    assert isinstance(line, Line)
    assert np.isnan(line.y[10])
    assert np.isnan(line.x[10])
    np.testing.assert_array_equal(line.y[11:21], np.arange(10.0))
    np.testing.assert_allclose(line.x[11:13], [5.0, 5.1])


def test_only_what_is_there():
    """Assert that a log of one encoder has one panel, with the motor alone."""
    chart = log_chart(Log((recording(0.0, link=False, drive=False),), (), "log", ""))
    assert len(chart.panels) == 1
    assert [mark.label for mark in chart.panels[0].marks] == ["motor"]
