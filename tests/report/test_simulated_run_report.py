"""Page and charts of a simulated run."""

from pathlib import Path

import numpy as np
import pytest

from flexid.experiments import read_experiment
from flexid.experiments.measures import measure
from flexid.report import simulated_run
from flexid.report.chart import Band, Level, Line
from flexid.report.page import page_html
from flexid.report.simulated_run import motion_chart, observer_chart
from flexid.simulation.closed_loop import Run

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
