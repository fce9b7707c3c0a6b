"""What every batch estimator must do, whichever it is: the same names, recordings and units."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from flexid.estimators.prediction_error import PredictionErrorFit, prediction_error
from flexid.estimators.rowwise import LeastSquaresFit
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.models.parametric_system import ParametricSystem, Row

TRUE = {"spring": 4.0, "friction": 0.5, "gain": 2.0}
OSCILLATOR = ParametricSystem(
    "oscillator", (Row("mass", "q", "v", {"spring": "-q", "friction": "-v", "gain": "u"}),)
)


BatchFit = LeastSquaresFit | PredictionErrorFit
Estimator = Callable[[Sequence[Samples], Unknowns], BatchFit]


def by_filter(recordings: Sequence[Samples], unknowns: Unknowns) -> BatchFit:
    """State-variable-filter least squares."""
    return filtered_least_squares(recordings, unknowns.system, unknowns=unknowns)


def by_motion(recordings: Sequence[Samples], unknowns: Unknowns) -> BatchFit:
    """Segmented prediction error, from the filter."""
    start = filtered_least_squares(recordings, unknowns.system, unknowns=unknowns)
    return prediction_error(recordings, unknowns.system, start, unknowns=unknowns)


estimators = pytest.mark.parametrize("estimate", [by_filter, by_motion])


def run(seed: int, duration: float = 30.0, h: float = 2e-3) -> Samples:
    """Two sines of random phase in closed form, the force that they take, and encoder noise."""
    generator = np.random.default_rng(seed)
    time = np.arange(round(duration / h)) * h
    slow, fast = 1.1 * time + generator.uniform(0, 6), 3.7 * time + generator.uniform(0, 6)
    position = np.sin(slow) + 0.4 * np.sin(fast)
    velocity = 1.1 * np.cos(slow) + 0.4 * 3.7 * np.cos(fast)
    acceleration = -(1.1**2) * np.sin(slow) - 0.4 * 3.7**2 * np.sin(fast)
    force = (acceleration + TRUE["spring"] * position + TRUE["friction"] * velocity) / TRUE["gain"]
    measured = position + 1e-4 * generator.standard_normal(len(time))
    return Samples(measured[:, None], None, force[:, None], h)


RUNS = [run(1), run(2, 20.0)]


def covers(fit: BatchFit) -> bool:
    """Whether every value is within five deviations of the truth, or 0.01 % of the rule's error."""
    truth = np.array([TRUE[name] for name in fit.names])
    allowed = 5.0 * np.sqrt(np.diag(fit.covariance)) + 1e-4 * truth
    return bool(np.all(np.abs(fit.values - truth) < allowed))


@estimators
def test_right_from_positions_alone(estimate: Estimator):
    """Assert that two runs give the truth to 0.1 %, within the deviations that are claimed."""
    fit = estimate(RUNS, Unknowns(OSCILLATOR))
    assert fit.names == OSCILLATOR.coefficients
    assert fit.values == pytest.approx(list(TRUE.values()), rel=1e-3)
    assert covers(fit)


@estimators
def test_results_speak_of_what_is_sought(estimate: Estimator):
    """Assert that all results have one entry for each name, and a proper covariance."""
    fit = estimate(RUNS, Unknowns(OSCILLATOR, {"friction": 0.5}, ("spring",), (0, 1)))
    assert fit.names == ("spring[1]", "spring[2]", "gain")
    assert fit.values.shape == (3,)
    assert fit.covariance.shape == fit.information.shape == (3, 3)
    assert len(fit.degrees_of_freedom) == 3
    for matrix in (fit.covariance, fit.information):
        assert matrix == pytest.approx(matrix.T, rel=1e-9)
        scale = np.sqrt(np.diag(matrix))
        assert np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min() > 0.0


@estimators
def test_indifferent_to_the_order_of_recordings(estimate: Estimator):
    """Assert that recordings in another order, with their groups, give each group the same."""
    ordered = estimate(RUNS, Unknowns(OSCILLATOR, {}, ("spring",), (0, 1)))
    turned = estimate(RUNS[::-1], Unknowns(OSCILLATOR, {}, ("spring",), (1, 0)))
    assert turned.values == pytest.approx(ordered.values, rel=1e-6)
    assert turned.covariance == pytest.approx(ordered.covariance, rel=1e-3)


@estimators
def test_units_of_the_input_change_its_gain_alone(estimate: Estimator):
    """Assert that an input a thousand times larger has a gain a thousand times smaller."""
    milli = [replace(recording, inputs=1e3 * recording.inputs) for recording in RUNS]
    fit, other = estimate(RUNS, Unknowns(OSCILLATOR)), estimate(milli, Unknowns(OSCILLATOR))
    assert other.values * [1.0, 1.0, 1e3] == pytest.approx(fit.values, rel=1e-6)
    assert np.sqrt(np.diag(other.covariance)) * [1.0, 1.0, 1e3] == pytest.approx(
        np.sqrt(np.diag(fit.covariance)), rel=1e-3
    )


@estimators
def test_a_right_fixed_value_leaves_the_rest_right(estimate: Estimator):
    """Assert that who knows the gain knows the others no worse."""
    free = estimate(RUNS, Unknowns(OSCILLATOR))
    fixed = estimate(RUNS, Unknowns(OSCILLATOR, {"gain": 2.0}))
    assert covers(fixed)
    known_gain = np.diag(np.linalg.inv(fixed.information))
    assert np.all(known_gain < np.diag(np.linalg.inv(free.information))[:2])


@estimators
def test_a_wrong_fixed_value_is_not_made_right(estimate: Estimator):
    """Assert that a gain fixed 10 % high brings the spring with it: what is fixed is believed."""
    fixed = estimate(RUNS, Unknowns(OSCILLATOR, {"gain": 2.2}))
    assert fixed.values[0] > 4.1


@estimators
def test_recordings_too_short_are_left_out(estimate: Estimator):
    """Assert that a recording of three samples changes nothing, whatever its group."""
    crumb = replace(RUNS[0], positions=RUNS[0].positions[:3], inputs=RUNS[0].inputs[:3])
    whole = estimate(RUNS, Unknowns(OSCILLATOR, {}, ("spring",), (0, 1)))
    with_crumb = estimate(
        [RUNS[0], crumb, RUNS[1]], Unknowns(OSCILLATOR, {}, ("spring",), (0, 0, 1))
    )
    assert np.array_equal(with_crumb.values, whole.values)
