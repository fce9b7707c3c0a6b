"""Charts of results: drawn values equal those found, and pages contain them."""

from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from shown import chart_lines, check

from flexid.experiments.experiment import read_experiment
from flexid.identification.vocabulary.evidence import FreeRun, Validation
from flexid.library.simulate import SimulatedRun
from flexid.report.chart import Band, Line, Panel
from flexid.report.page import page_html
from flexid.report.reproduction import charts as reproduction_charts
from flexid.report.reproduction import parts
from flexid.report.response_charts import free_run_chart, residual_chart
from flexid.report.simulated_run import motion_chart, observer_chart
from flexid.report.terminal import print_parts
from flexid.simulation.closed_loop import Run

M = TypeVar("M")


def marks(panel: Panel, kind: type[M]) -> list[M]:
    """Return marks of one kind."""
    return [mark for mark in panel.marks if isinstance(mark, kind)]


def test_channels_of_several_joints_have_units_of_their_own():
    """Assert the labels and units of axes, for joints that turn and slide."""
    seen = np.random.default_rng(3).standard_normal((20, 2))
    runs = (FreeRun(np.arange(20.0), seen, np.zeros_like(seen)),)
    fits = {"link_position_1": 90.0, "deflection_2": 80.0}
    chart = free_run_chart("fit", "", Validation(fits, runs), {}, ("revolute", "prismatic"))
    axes = [(panel.y.label, panel.y.unit) for panel in chart.panels]
    assert axes[::2] == [("position", "rad"), ("deflection", "m")]
    assert axes[1::2] == [("residual", "rad"), ("residual", "m")]


def test_residuals_that_repeat_leave_the_band():
    """Assert that noise is outside its band in a twentieth of the lags, and a sine in most."""
    generator = np.random.default_rng(3)
    time = np.linspace(0.0, 20.0, 20_001)
    noise = generator.standard_normal(len(time))
    measured = np.column_stack([noise, noise + np.sin(2.0 * time)])
    runs = (FreeRun(time, measured, np.zeros_like(measured)),)
    chart = residual_chart(
        Validation({"link_position": 1.0, "motor_position": 1.0}, runs), ("revolute",)
    )
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
    lost = residual_chart(
        Validation({"link_position": -np.inf, "motor_position": 0.0}, diverged), ("revolute",)
    )
    assert not marks(lost.panels[1], Line)


EXPERIMENT = read_experiment(Path(__file__).parents[2] / "experiments" / "huang2003.toml")


@pytest.fixture(scope="module")
def run() -> Run:
    """Return a run of Table I for some seconds."""
    return EXPERIMENT.with_values({"run.duration": 25.0}).run()


def test_a_run_is_on_its_page(run: Run):
    """Assert that the page has the table, the figures, the lines, the command and the file."""
    made = page_html(SimulatedRun(EXPERIMENT, run)._page("flexid simulate x"))
    assert made.count('class="chart"') == 2
    for text in ("theta1", "Tracking error:", "flexid simulate x", EXPERIMENT.digest):
        assert text in made


def test_charts_of_a_run(run: Run, request: pytest.FixtureRequest):
    """Assert the marks of a run, with the torque of the first instants cut off and noted."""
    charts = motion_chart("Table I", run), observer_chart("Table I", run)
    lines = (line for chart in charts for line in chart_lines(chart))
    check("run_charts", lines, request, computed=True)


def test_charts_of_the_reproduction(reproduction, request: pytest.FixtureRequest):
    """Assert the marks of Figures 1 to 5 and of Theorem 1."""
    charts = reproduction_charts(reproduction)
    lines = (line for chart in charts for line in chart_lines(chart))
    check("reproduction_charts", lines, request, computed=True)


def test_claims_of_the_reproduction(reproduction, request: pytest.FixtureRequest):
    """Assert the verdict on every claim, and the values that decide it unless nearly zero."""
    lines = (
        f"{claim.key}, {claim.verdict}: {one.subject}, {one.quantity} "
        f"{one.value * (abs(one.value) > 1e-6):.3e} {one.unit}"
        for claim in reproduction.claims
        for one in claim.findings
    )
    check("claims", lines, request, computed=True)


def test_printed_tables_fit_80_columns(reproduction, capsys):
    """Assert that no line is longer than 80 characters and every claim is printed."""
    print_parts(parts(reproduction))
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert sum("holds" in line or "does not hold" in line for line in lines) >= 15
