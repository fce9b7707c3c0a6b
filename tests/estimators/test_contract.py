"""What every estimator must do, whichever it is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from flexid.errors import ConvergenceError
from flexid.estimators.online import packed
from flexid.estimators.parametric_observer import parametric_observer, suggest_gains
from flexid.estimators.prediction_error import prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.parametric_system import ParametricSystem, Row

TRUE = {"spring": 4.0, "friction": 0.5, "gain": 2.0}
REGRESSORS = {"spring": "-q", "friction": "-v", "gain": "u"}
Estimator = Callable[[Samples, ParametricSystem], dict[str, float]]


def oscillator(names=("spring", "friction", "gain")) -> ParametricSystem:
    """A mass on a spring, its coefficients declared in the given order."""
    regressors = {name: REGRESSORS[name] for name in names}
    return ParametricSystem("oscillator", (Row("mass", "q", "v", regressors),))


def exciting_motion(duration: float = 60.0, h: float = 2e-3) -> Samples:
    """A motion known in closed form: two sines, with the force that the oscillator needs."""
    time = np.arange(round(duration / h)) * h
    position = np.sin(1.1 * time) + 0.4 * np.sin(3.7 * time)
    velocity = 1.1 * np.cos(1.1 * time) + 0.4 * 3.7 * np.cos(3.7 * time)
    acceleration = -(1.1**2) * np.sin(1.1 * time) - 0.4 * 3.7**2 * np.sin(3.7 * time)
    force = (acceleration + TRUE["spring"] * position + TRUE["friction"] * velocity) / TRUE["gain"]
    return Samples(position[:, None], velocity[:, None], force[:, None], h)


def least_squares(samples: Samples, system: ParametricSystem) -> dict[str, float]:
    """State-variable-filter least squares."""
    fit = filtered_least_squares([samples], system)
    return dict(zip(fit.names, fit.values.tolist(), strict=True))


def motion(samples: Samples, system: ParametricSystem) -> dict[str, float]:
    """Segmented prediction error on positions, from least squares."""
    fit = prediction_error([samples], system, filtered_least_squares([samples], system))
    return dict(zip(fit.names, fit.values.tolist(), strict=True))


def observer(samples: Samples, system: ParametricSystem) -> dict[str, float]:
    """The parametric observer with suggested gains, from zero."""
    gains = suggest_gains(samples, system, convergence_rate=20.0)
    built = parametric_observer(system, gains, samples.sample_time)
    last = built.replay(built.init(), packed(samples)).coefficients[-1]
    return dict(zip(system.coefficients, last.tolist(), strict=True))


estimators = pytest.mark.parametrize("estimate", [least_squares, motion, observer])


@estimators
def test_exact_on_clean_exciting_data(estimate: Estimator):
    """Assert that clean, exciting data give the truth up to the rule's error in the sample time."""
    assert estimate(exciting_motion(), oscillator()) == pytest.approx(TRUE, rel=1e-4)


@estimators
def test_deterministic(estimate: Estimator):
    """Assert that the same data give the same bits."""
    samples = exciting_motion(5.0)
    assert estimate(samples, oscillator()) == estimate(samples, oscillator())


@estimators
def test_indifferent_to_the_order_of_coefficients(estimate: Estimator):
    """Assert that declaring coefficients in another order changes no value."""
    samples = exciting_motion(20.0)
    turned = estimate(samples, oscillator(("gain", "spring", "friction")))
    assert turned == pytest.approx(estimate(samples, oscillator()), rel=1e-9)


@estimators
@pytest.mark.parametrize("level", [0.0, 0.3])
def test_no_divergence_at_rest(estimate: Estimator, level: float):
    """Assert that a mass at rest, in the middle or aside, gives finite and modest values."""
    still = exciting_motion(5.0)
    rest = replace(
        still,
        positions=np.full_like(still.positions, level),
        velocities=np.zeros_like(still.positions),
        inputs=np.full_like(still.inputs, 2.0 * level),
    )
    values = estimate(rest, oscillator())
    assert all(abs(value) < 100.0 for value in values.values())


@estimators
def test_no_divergence_on_a_single_sine(estimate: Estimator):
    """Assert that a motion that cannot tell spring from force gives finite values or an error."""
    h = 2e-3
    time = np.arange(5000) * h
    position = np.sin(time)[:, None]
    noise = 1e-4 * np.random.default_rng(3).standard_normal(position.shape)
    force = ((TRUE["spring"] - 1.0) * position + TRUE["friction"] * np.cos(time)[:, None]) / 2.0
    samples = Samples(position + noise, np.cos(time)[:, None], force, h)
    try:
        values = estimate(samples, oscillator())
    except ConvergenceError:  # no wrong number either
        return
    assert all(np.isfinite(value) and abs(value) < 1e3 for value in values.values())


@estimators
def test_the_record_is_left_as_it_was(estimate: Estimator):
    """Assert that an estimator does not write into the samples it is given."""
    samples = exciting_motion(5.0)
    arrays = [samples.positions, samples.velocities, samples.inputs]
    before = [np.copy(array) for array in arrays if array is not None]
    estimate(samples, oscillator())
    assert all(np.array_equal(a, b) for a, b in zip(arrays, before, strict=True) if a is not None)
