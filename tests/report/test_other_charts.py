"""Charts of a log, of a simulated run, and of the paper's loop beside another run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from flexid.experiments import read_experiment
from flexid.recording.recording import Log, Recording
from flexid.report.chart import Band, Level, Line
from flexid.report.free_run_chart import log_chart
from flexid.report.reproduction_charts import Played, play_chart
from flexid.report.simulated_run import motion_chart, observer_chart
from flexid.simulation.run import Run


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


FOLDER = Path(__file__).parents[2] / "experiments"


@pytest.fixture(scope="module")
def run() -> Run:
    """Return Table I, run for some seconds."""
    return read_experiment(FOLDER / "huang2003.toml").with_values({"run.duration": 25.0}).run()


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
    largest = np.abs(run.tracking_error[run.time >= 12.5]).max()
    assert f"stays within {largest:.3g} rad" in chart.says


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
    settled = sum(abs(e) < 0.05 * run.loop.coefficients[n] for n, e in run.final_errors().items())
    assert f"At the end {settled} of 4" in chart.says


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
