"""A run in numbers."""

from pathlib import Path

import numpy as np
import pytest

from flexid.experiments import Experiment, read_experiment
from flexid.experiments.measures import Measures, measure, settling_times
from flexid.simulation.ensemble import Ensemble, simulate_ensemble, simulate_sampled_ensemble

FOLDER = Path(__file__).parents[2] / "experiments"


@pytest.fixture(scope="module")
def sampled() -> tuple[Measures, Ensemble]:
    """Return both measures of a noisy sampled run whose torque meets its limit."""
    values = {"run.duration": 12.0, "sampling.sample_time": 2e-3, "sampling.input_limit": 20.0}
    experiment = read_experiment(FOLDER / "sampled_joint.toml").with_values(values)
    assert experiment.sampling is not None
    run = experiment.run()
    assert run.statistics["limited_samples"] > 10
    ensemble = simulate_sampled_ensemble(
        [experiment.loop], experiment.settings.duration, [experiment.sampling]
    )
    return measure(run), ensemble


def by_both(experiment: Experiment) -> tuple[Measures, Ensemble]:
    """Return both measures of a continuous experiment."""
    ensemble = simulate_ensemble([experiment.loop], **experiment.settings.model_dump())
    return measure(experiment.run()), ensemble


@pytest.fixture(scope="module")
def table1() -> tuple[Measures, Ensemble]:
    """Return both measures of Table I, its first transient resolved by samples 10 us apart."""
    values = {"run.duration": 2.0, "run.sample_time": 1e-5}
    return by_both(read_experiment(FOLDER / "huang2003.toml").with_values(values))


def values(numbers) -> np.ndarray:
    """Return the values of a mapping in its order."""
    return np.array(list(numbers.values()))


@pytest.mark.parametrize("case", ["sampled", "table1"])
def test_ends_and_peak_input_are_the_same_bits(case: str, request: pytest.FixtureRequest):
    """Assert that what is no sum and lies at a sample in both ways is the same number."""
    measures, ensemble = request.getfixturevalue(case)
    assert np.array_equal(values(measures.final_states), ensemble.final_states[0])
    assert np.array_equal(values(measures.final_errors), ensemble.final_errors[0])
    assert np.array_equal(values(measures.peak_inputs), ensemble.peak_input[0])


def test_sampled_measures_differ_by_rounding(sampled: tuple[Measures, Ensemble]):
    """Assert that the same samples give the same measures, up to the order of summation."""
    measures, ensemble = sampled
    found = values(measures.settling_times)
    assert np.isfinite(found).any()
    assert np.array_equal(found, ensemble.settling_time[0], equal_nan=True)
    assert measures.tracking_peak == ensemble.tracking_peak[0]
    assert measures.tracking_rms == pytest.approx(ensemble.tracking_rms[0], rel=1e-12)
    conditions = [one.condition_number for one in measures.excitation.values()]
    assert ensemble.excitation[0] == pytest.approx(conditions, rel=1e-9)


def test_measures_of_table1_agree_to_within_a_step(table1: tuple[Measures, Ensemble]):
    """Assert agreement as far as the integrator's steps, some milliseconds long, let it be.

    Peaks and settling times fall between two steps. The trapezoidal rule over such steps has an
    error of some 1e-4 of the mean; ten times that is allowed.
    """
    measures, ensemble = table1
    found = values(measures.settling_times)
    assert np.isfinite(found).any()
    np.testing.assert_allclose(ensemble.settling_time[0], found, rtol=0.0, atol=0.01)
    assert measures.tracking_peak == pytest.approx(ensemble.tracking_peak[0], rel=1e-3)
    assert measures.tracking_rms == pytest.approx(ensemble.tracking_rms[0], rel=1e-3)
    conditions = [one.condition_number for one in measures.excitation.values()]
    assert ensemble.excitation[0] == pytest.approx(conditions, rel=1e-3)


def test_coarse_samples_overrate_a_short_transient():
    """Assert that the documented limit is there: samples of 1 ms count microseconds as one."""
    experiment = read_experiment(FOLDER / "huang2003.toml").with_values({"run.duration": 2.0})
    measures, ensemble = by_both(experiment)
    assert measures.excitation["motor"].condition_number > 2.0 * ensemble.excitation[0, 1]
    assert measures.tracking_rms == pytest.approx(ensemble.tracking_rms[0], rel=1e-3)


def test_settling_time_is_the_last_time_beyond():
    """Assert settling for errors that leave the band again, never enter and never leave it."""
    time = np.array([0.0, 1.0, 2.0, 3.0])
    errors = np.array([[1.0, -9.0, 0.4], [0.1, -9.0, 0.4], [-0.6, -9.0, -0.4], [0.5, -9.0, 0.4]])
    found = settling_times(time, errors, np.array([-10.0, 10.0, 10.0]))
    assert found[0] == 2.0
    assert np.isnan(found[1])
    assert found[2] == 0.0
