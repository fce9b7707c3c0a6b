"""Measures of a run from its samples."""

from pathlib import Path

import numpy as np
import pytest

from flexid.experiments import read_experiment
from flexid.experiments.measures import measure, settling_times

FOLDER = Path(__file__).parents[2] / "experiments"


def test_settling_time_is_the_last_time_beyond():
    """Assert settling for errors that leave the band again, never enter and never leave it."""
    time = np.array([0.0, 1.0, 2.0, 3.0])
    errors = np.array([[1.0, -9.0, 0.4], [0.1, -9.0, 0.4], [-0.6, -9.0, -0.4], [0.5, -9.0, 0.4]])
    found = settling_times(time, errors, np.array([-10.0, 10.0, 10.0]))
    assert found[0] == 2.0
    assert np.isnan(found[1])
    assert found[2] == 0.0


def test_measures_of_a_run_are_those_of_its_series():
    """Assert peaks, means and ends against the series themselves."""
    run = read_experiment(FOLDER / "sampled_joint.toml").with_values({"run.duration": 2.0}).run()
    measures = measure(run)
    assert measures.final_states["x3"] == run.states[-1, 2]
    assert measures.final_errors["alpha1"] == run.parameter_errors[-1, 2]
    assert measures.tracking_peak == max(abs(run.tracking_error.min()), run.tracking_error.max())
    assert measures.tracking_rms**2 == pytest.approx(
        float(np.var(run.tracking_error) + np.mean(run.tracking_error) ** 2)
    )
    assert measures.peak_inputs["u"] == np.abs(run.inputs).max()
    x = run.states
    rows = np.stack([x[:, 0] - x[:, 2], -x[:, 3]])
    correlation = rows[0] @ rows[1] / np.sqrt((rows[0] @ rows[0]) * (rows[1] @ rows[1]))
    expected = (1 + abs(correlation)) / (1 - abs(correlation))  # of a 2 by 2 with unit diagonal
    assert measures.excitation["motor"].condition_number == pytest.approx(expected)
