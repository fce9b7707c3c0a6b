"""Charts of results: what is drawn is what was found, and pages hold it."""

from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from made_campaign import made_summary
from made_result import VALIDATION, made_result

from flexid.campaigns.summary import Result
from flexid.experiments import read_experiment
from flexid.experiments.measures import measure
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import (
    CoefficientEstimate,
    FreeRun,
    Validation,
)
from flexid.library.simulate import CampaignResult
from flexid.report import simulated_run
from flexid.report.chart import Band, Level, Line, Panel
from flexid.report.page import page_html
from flexid.report.reproduction import parts
from flexid.report.reproduction_charts import error_chart, reproduction_charts, theorem_chart
from flexid.report.response_charts import identification_charts, residual_chart
from flexid.report.simulated_run import motion_chart, observer_chart
from flexid.report.terminal import print_parts
from flexid.simulation.closed_loop import Run

M = TypeVar("M")
COVARIANCE = np.array([[9.0, 0.05], [0.05, 0.0009]])


def marks(panel: Panel, kind: type[M]) -> list[M]:
    """Marks of one kind."""
    return [mark for mark in panel.marks if isinstance(mark, kind)]


def test_residuals_that_repeat_leave_the_band():
    """Assert that noise leaves its band in a twentieth of the lags, and a sine in most."""
    generator = np.random.default_rng(3)
    time = np.linspace(0.0, 20.0, 20_001)
    noise = generator.standard_normal(len(time))
    measured = np.column_stack([noise, noise + np.sin(2.0 * time)])
    runs = (FreeRun(time, measured, np.zeros_like(measured)),)
    chart = residual_chart(Validation({"link_position": 1.0, "motor_position": 1.0}, runs))
    assert [panel.x.label for panel in chart.panels] == ["time", "lag"] * 2
    shares = []
    for panel in chart.panels[1::2]:
        (band,), (line,) = marks(panel, Band), marks(panel, Line)
        assert line.x[0] == 0.0
        assert line.y[0] == pytest.approx(1.0)
        shares.append(np.mean(np.abs(line.y[1:]) > band.high[0]))
    assert 0.03 < shares[0] < 0.07
    assert shares[1] > 0.8
    diverged = (FreeRun(time, measured, np.full_like(measured, np.inf)),)
    lost = residual_chart(Validation({"link_position": -np.inf, "motor_position": 0.0}, diverged))
    assert not marks(lost.panels[1], Line)


def test_a_loaded_estimate_has_the_charts_that_need_no_series():
    """Assert that time series are left out where there are none."""
    coefficients = {
        name: CoefficientEstimate(name, "1/s^2", value, 0.1, (1.0, 9.0), "determined")
        for name, value in (("theta1", 5.0), ("theta2", 100.0), ("alpha1", 333.0), ("beta1", 3.0))
    }
    fit = Estimate(("alpha1", "beta1"), np.array([300.0, 3.0]), COVARIANCE, (9.0, 9.0))
    whole = replace(made_result(), coefficients=coefficients, fit=fit)
    names = ["fit", "residuals", "bode"]
    assert [chart.name for chart in identification_charts(whole)] == names
    loaded = replace(whole, validation=replace(VALIDATION, runs=()))
    assert [chart.name for chart in identification_charts(loaded)] == ["bode"]
    assert all(chart.says for chart in identification_charts(loaded))


EXPERIMENT = read_experiment(Path(__file__).parents[2] / "experiments" / "huang2003.toml")


@pytest.fixture(scope="module")
def simulated():
    """Return a short experiment, its run and that in numbers."""
    experiment = EXPERIMENT.with_values({"run.duration": 1.0})
    run = experiment.run()
    return experiment, run, measure(run)


def test_a_run_is_on_its_page(simulated):
    """Assert that the HTML has the table, the figures, the lines, the command and the file."""
    experiment, run, measures = simulated
    charts = simulated_run.charts(experiment, run, measures)
    page = simulated_run.PRESENTER.page(simulated, charts, (), "flexid simulate x")
    made = page_html(page)
    assert made.count('class="chart"') == 2
    for text in ("theta1", "Tracking error:", "flexid simulate x", experiment.digest):
        assert text in made


@pytest.fixture(scope="module")
def run() -> Run:
    """Return Table I, run for some seconds."""
    return EXPERIMENT.with_values({"run.duration": 25.0}).run()


def test_transient_does_not_hide_the_rest(run: Run):
    """Assert that the torque of the first instants leaves the frame, and the title says so."""
    drive = motion_chart("Table I", run).panels[2]
    assert np.abs(run.inputs).max() > 1e6
    assert drive.y.limits is not None
    assert drive.y.limits[1] < 200
    assert drive.title.startswith("Motor torque; beyond the frame: up to ")


def test_the_motion_is_that_of_the_run(run: Run):
    """Assert that reference, tracked state, error and torque are the run's, with units."""
    chart = motion_chart("Table I", run)
    drawn = [mark.y for panel in chart.panels for mark in panel.marks if isinstance(mark, Line)]
    wanted = (run.reference[:, 0], run.states[:, 0], run.tracking_error, run.inputs[:, 0])
    for found, values in zip(drawn, wanted, strict=True):
        assert np.array_equal(found, values)
    assert [panel.y.unit for panel in chart.panels] == ["rad", "rad", "N m"]


def test_every_estimate_is_drawn_beside_its_truth(run: Run):
    """Assert that each panel holds the estimate, the true value and the band about it."""
    chart = observer_chart("Table I", run)
    system = run.loop.system
    for place, (panel, name) in enumerate(zip(chart.panels, system.coefficients, strict=True)):
        band, true, estimate = panel.marks
        assert panel.title == name
        assert isinstance(band, Band)
        assert isinstance(true, Level)
        assert isinstance(estimate, Line)
        assert true.value == run.loop.coefficients[name]
        assert [band.low[0], band.high[0]] == pytest.approx([0.95 * true.value, 1.05 * true.value])
        assert np.array_equal(estimate.y, run.estimates[:, place])


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


def test_the_document_is_json():
    """Assert that numbers that JSON does not have become null."""
    nothing = Result("settling_time.theta1", 0, 1, (np.nan, np.nan, np.nan), ())
    document = CampaignResult(made_summary(results=(nothing,))).document
    found = document["results"]["settling_time.theta1"]
    assert found["quantiles"] == {"0.05": None, "0.5": None, "0.95": None}
    assert (found["finite"], found["missing"]) == (0, 1)
    assert document["complete"]
