"""Charts, tables and document of the reproduction."""

import numpy as np
import pytest

from flexid.report.chart import Line
from flexid.report.reproduction import parts
from flexid.report.reproduction_charts import error_chart, reproduction_charts, theorem_chart
from flexid.report.terminal import print_parts


def test_printed_tables_fit_80_columns(reproduction, capsys):
    """Assert that no line is longer than 80 characters and every claim is printed."""
    print_parts(parts(reproduction))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert sum("holds" in line or "does not hold" in line for line in lines) >= 15


def test_charts_name_quantities_and_units(reproduction):
    """Assert that every panel of Figures 1 to 5 has a labelled quantity with its unit."""
    charts = reproduction_charts(reproduction)
    assert [chart.name for chart in charts] == [f"figure{n}" for n in range(1, 6)] + ["theorem1"]
    assert {(panel.y.label, panel.y.unit) for panel in charts[0].panels} == {
        ("tracking error", "rad")
    }
    for chart, unit in zip(charts[1:5], ("1/s²", "1/s²", "1/s²", "1/s"), strict=True):
        assert {panel.y.unit for panel in chart.panels} == {unit}
        assert {(panel.x.label, panel.x.unit) for panel in chart.panels} == {("time", "s")}


@pytest.mark.parametrize("reading", ["1,2,3", "1,1,3"])
def test_figure_2_draws_the_run(reproduction, reading):
    """Assert that the curve of Figure 2 is the run's, and ends at its error."""
    run = reproduction.runs[reading]
    whole = error_chart(reproduction.runs, "theta1", 2).panels[0]
    (line,) = (mark for mark in whole.marks if mark.label == f"gains ({reading})")
    assert isinstance(line, Line)
    assert np.array_equal(line.y, run.run.parameter_errors[:, 0])
    assert line.y[-1] == run.parameter_errors["theta1"]


def test_peaks_of_an_error_stand_amid_their_samples(reproduction):
    """Assert that each tenth of a second shows its largest value at the mean of its times."""
    run = reproduction.runs["1,2,3"].run
    line = error_chart(reproduction.runs, "theta1", 2).panels[1].marks[0]
    assert isinstance(line, Line)
    assert line.x[:2] == pytest.approx([0.0495, 0.1495], abs=1e-9)
    assert line.y[1] == np.abs(run.parameter_errors[100:200, 0]).max()


def test_theorem_chart_has_value_and_rates(reproduction):
    """Assert that V is drawn for both readings and three rates for both rows."""
    chart = theorem_chart(reproduction.runs, reproduction.rates)
    lines = [[m for m in panel.marks if isinstance(m, Line)] for panel in chart.panels]
    assert [len(found) for found in lines] == [2, 3, 3]
    rates = reproduction.rates["link"]
    wanted = [[getattr(p, name) for p in rates] for name in ("averaged", "measured", "guaranteed")]
    assert [line.y.tolist() for line in lines[1]] == wanted
    assert lines[0][0].y[-1] == reproduction.runs["1,2,3"].monitor.value[-1]
    assert "At 16 of 16 gains" in chart.says
