"""Figures of a simulated run: what they show."""

from pathlib import Path

import numpy as np
import pytest

from flexid.experiments import read_experiment
from flexid.report.run_figures import motion_figure, observer_figure, save_run_figures
from flexid.simulation.run import Run

FOLDER = Path(__file__).parents[2] / "experiments"


@pytest.fixture(scope="module")
def run() -> Run:
    """Return Table I, run for some seconds."""
    return read_experiment(FOLDER / "huang2003.toml").with_values({"run.duration": 25.0}).run()


def test_transient_does_not_hide_the_rest(run: Run):
    """Assert that the torque of the first instants leaves the frame, and the title says so."""
    drive = motion_figure("Table I", run).axes[2]
    assert np.abs(run.inputs).max() > 1e6
    assert drive.get_ylim()[1] < 200
    assert "beyond the frame" in drive.get_title()


def test_every_estimate_is_drawn_beside_its_truth(run: Run):
    """Assert that each panel holds the estimate to its end and the true value."""
    axes = observer_figure("Table I", run).axes
    for place, (ax, name) in enumerate(zip(axes, run.loop.system.coefficients, strict=True)):
        true, estimate = ax.lines
        assert ax.get_title() == name
        assert set(np.asarray(true.get_ydata())) == {run.loop.coefficients[name]}
        drawn = np.asarray(estimate.get_ydata())
        assert drawn[0] == run.estimates[0, place]
        assert len(drawn) <= 20_000


def test_long_run_is_thinned(run: Run):
    """Assert that a run of more samples than a figure can show is drawn with fewer."""
    line = motion_figure("Table I", run).axes[0].lines[0]
    assert len(run.time) > 20_000
    assert len(np.asarray(line.get_xdata())) <= 20_000


def test_title_is_no_formula(run: Run, tmp_path: Path):
    """Assert that a name with dollars and a command is drawn as it is, over several lines."""
    name = r"gain $\frac of $x, " + 12 * "and longer "
    save_run_figures(name, run, tmp_path)
    title = motion_figure(name, run).get_suptitle()
    assert title.splitlines()[0].startswith(r"gain $\frac of $x, and")
    assert max(map(len, title.splitlines())) <= 75
