"""Residuals beside what the noise of the positions explains."""

import numpy as np
import pytest

from flexid.estimators.samples import samples_of_recording
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.estimators.unknowns import Unknowns
from flexid.identification.residuals import residual_excess
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.recording import Recording
from flexid.recording.velocities import with_velocities
from flexid.simulation.free_run import free_run

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}


def record(noise=1e-4, bits=None, delay=0.0, sample_time=2e-3):
    """Twenty seconds of Table I's joint under two tones, the input recorded late by a delay."""
    t = np.arange(0, 20, sample_time)

    def torque(t):
        return 20 * np.sin(2 * t) + 10 * np.sin(5.3 * t)

    x = free_run(flexible_joint(), TRUE, np.zeros(4), torque(t), sample_time)
    q = x[:, [0, 2]] + noise * np.random.default_rng(5).standard_normal((len(t), 2))
    if bits is not None:
        step = 2 * np.pi / 2**bits
        q = np.round(q / step) * step
    link, motor = np.ascontiguousarray(q.T)
    return with_velocities(Recording(sample_time, 0.0, link, motor, torque(t - delay), "N m"))


def excess(recording, filter_rate=20.0):
    """Excess of both rows."""
    system = flexible_joint()
    samples = [samples_of_recording(recording)]
    fit = filtered_least_squares(samples, system, filter_rate)
    return residual_excess(fit, Unknowns(system), samples)


@pytest.mark.parametrize("filter_rate", [5.0, 20.0, 80.0])
@pytest.mark.parametrize("sensor", [{"noise": 1e-5}, {"noise": 1e-3}, {"noise": 0, "bits": 14}])
def test_right_model_leaves_what_noise_explains(sensor, filter_rate):
    """Assert that the prediction is right for white noise and for encoders, at any filter rate."""
    ratios = excess(record(**sensor), filter_rate)
    assert ratios["link"] == pytest.approx(1, abs=0.12)
    assert ratios["motor"] == pytest.approx(1, abs=0.12)


def test_late_input_shows_in_its_row_only():
    """Assert that an input recorded 5 ms late shows in the motor's row and not in the link's."""
    ratios = excess(record(delay=5e-3))
    assert ratios["motor"] > 5
    assert ratios["link"] < 1.2
