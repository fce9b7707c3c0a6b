"""A run of the paper's closed loop beside another, as a chart."""

from __future__ import annotations

import numpy as np

from flexid.report.chart import Line
from flexid.report.reproduction_charts import Played, play_chart


def played(scale: float) -> Played:
    """Return a run whose errors fall, with a zero among them."""
    time = np.linspace(0.0, 30.0, 3001)
    falling = scale * np.exp(-time)
    falling[300:340] = 0.0
    moments = np.linspace(2.0, 30.0, 40)
    return Played(
        time,
        falling,
        {"theta1": falling, "alpha1": 2 * falling},
        {"theta1": (1.0, "%"), "alpha1": (2.0, "%")},
        falling**2,
        moments,
        {"link": 3.0 + moments},
        1.0,
        2.0,
    )


def test_a_pinned_run_is_dashed_and_lies_behind():
    """Assert that both are drawn in one scale, and the legend names each line once."""
    chart = play_chart(played(1.0), played(2.0))
    lines = [m for m in chart.panels[1].marks if isinstance(m, Line)]
    assert [(line.label, line.dash) for line in lines] == [
        ("", "dashed"),
        ("", "dashed"),
        ("θ₁", "solid"),
        ("α₁", "solid"),
    ]
    assert lines[0].colour == lines[2].colour


def test_an_error_is_drawn_by_its_size():
    """Assert that a stretch shows its largest value, and zero is a gap on a logarithmic axis."""
    (line,) = play_chart(played(1.0), None).panels[0].marks
    assert isinstance(line, Line)
    assert np.isnan(line.y).any()
    assert np.nanmin(line.y) > 0.0
    assert line.y[0] == 1.0
    assert len(line.y) <= 160
