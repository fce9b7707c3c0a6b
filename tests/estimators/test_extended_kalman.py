"""The extended Kalman filter, with least squares beside it."""

from dataclasses import replace

import numpy as np
import pytest
from noisy_joint import (
    POSITION_NOISE,
    SAMPLE_TIME,
    TRUTH,
    VELOCITY_NOISE,
    joint_samples,
    worst_error,
)

from flexid.errors import SettingError
from flexid.estimators.extended_kalman import extended_kalman_filter
from flexid.estimators.online import Status
from flexid.models.flexible_joint import flexible_joint

JOINT = flexible_joint()


@pytest.mark.parametrize("velocity_noise", [None, VELOCITY_NOISE], ids=["encoders", "all states"])
def test_accuracy(velocity_noise):
    """Assert the figure of the design, 0.013 % median of 10 seeds, told the noise."""
    estimator = extended_kalman_filter(JOINT, SAMPLE_TIME, POSITION_NOISE, velocity_noise)
    last = []
    for seed in range(10):
        samples = joint_samples(seed)
        if velocity_noise is None:
            samples = replace(samples, velocities=None)
        start = estimator.init({name: 0.5 * value for name, value in TRUTH.items()})
        last.append(worst_error(estimator.replay(start, estimator.pack(samples)).coefficients[-1]))
    assert np.median(last) <= 0.013


def test_lost_and_found():
    """Assert that a start that loses the filter is found out by least squares, and made good."""
    estimator = extended_kalman_filter(JOINT, SAMPLE_TIME, POSITION_NOISE)
    samples = estimator.pack(replace(joint_samples(0), velocities=None))
    start = estimator.init({name: 1e-3 * value for name, value in TRUTH.items()})
    history = estimator.replay(start, samples)
    assert np.any(history.status == Status.CONTRADICTED)
    assert np.all(history.status[:999] == Status.STARTING)
    assert worst_error(history.coefficients[-1]) < 0.1


def test_its_own_deviations_cover_the_errors():
    """Assert that no error of 5 seeds exceeds four of the filter's standard deviations."""
    estimator = extended_kalman_filter(JOINT, SAMPLE_TIME, POSITION_NOISE)
    for seed in range(5):
        samples = estimator.pack(replace(joint_samples(seed), velocities=None))
        history = estimator.replay(estimator.init(), samples)
        errors = np.abs(history.coefficients[-1] - list(TRUTH.values()))
        assert np.all(errors < 4.0 * estimator.standard_deviations(history.state))


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"position_noise": 0.0}, "position noise"),
        ({"position_noise": 1e-4, "velocity_noise": -1.0}, "velocity noise"),
        ({"position_noise": 1e-4, "acceleration_noise": 0.0}, "acceleration noise"),
        ({"position_noise": 1e-4, "drift": float("nan")}, "drift"),
    ],
)
def test_noise_that_is_none(settings, message):
    """Assert that the filter is not built without noise to tell it of."""
    with pytest.raises(SettingError, match=message):
        extended_kalman_filter(JOINT, SAMPLE_TIME, **settings)
