"""What noise and lag of a measured input do to what it drives."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from made_joint import COEFFICIENTS, PAPER, PUSHED, SAMPLE_TIME, data, made, pushed, seen, structure

from flexid.estimators.channel_timing import INPUT, Timing
from flexid.identification.estimation.disturbed import fit_disturbed
from flexid.identification.estimation.measured_input import input_noise, lagged, pulled
from flexid.identification.estimation.model_error import widened
from flexid.identification.full_model.fitting import fit_to
from flexid.identification.full_model.model import Fitted, Structure, data_of
from flexid.identification.preparation.joint import link
from flexid.identification.vocabulary.evidence import ModelError
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.recording.recording import Recording
from flexid.recording.velocities import with_velocities

JOINT = link()
GRAVITY = Structure(JOINT, JOINT.optional - {"theta1"}, Timing("cubic"))
TRUTH = {"theta1": 5.0, "theta2": 100.0}
NOISE = 2e-4  # rad, of the motor's encoder; twenty times that of the link's


@cache
def fitted(seed: int, noise: float = NOISE) -> Fitted:
    """The link with gravity fitted to ten seconds of it, driven by a noisy motor position."""
    recording = made(seed)
    count = len(recording)
    motor = noise * np.random.default_rng(seed).standard_normal(count)
    recording = seen(recording, np.zeros(count), motor)
    recording = with_velocities(replace(recording, input=None, input_unit=""))
    data = data_of(JOINT, [recording], (0,))
    return fit_to(GRAVITY, data, TRUTH, 1.0)[0]


@pytest.mark.parametrize("seed", [1, 2])
def test_residuals_are_explained(seed):
    """Assert that residuals far above the link's noise are what the motor's noise makes of them."""
    found = fitted(seed)
    beyond = found.excess - 1.0
    assert beyond > 2.0
    assert 0.8 * beyond < input_noise(found).excess < 3.0 * beyond


def test_fine_encoder_explains_nothing():
    """Assert that an encoder as fine as the link's adds little to residuals of pure noise."""
    assert input_noise(fitted(3, 0.0)).excess < 0.2


def test_deviations_are_those_of_many_logs():
    """Assert that the estimates of thirty logs scatter as one of them foretells."""
    values = np.array([fitted(seed).values for seed in range(10, 40)])
    scatter = np.sqrt(np.mean((values - [*TRUTH.values()]) ** 2, axis=0))
    foretold = np.mean([input_noise(fitted(seed)).deviations for seed in range(10, 14)], axis=0)
    np.testing.assert_allclose(scatter, foretold, rtol=0.5)


def test_no_interval_is_narrower():
    """Assert that an interval is as wide as the noise of the input makes it, blocks or not."""
    found = fitted(1)
    none = ModelError(0.0, 0.0, 0.0)
    least = 10.0 * found.fit.deviations
    deviations = widened(found, none, least).deviations
    assert deviations == pytest.approx(least)
    assert (widened(found, none).deviations < deviations).all()


@cache
def gain(seed: int, noise: float, motor_push: float = 0.0) -> tuple[float, float]:
    """Errors of a drive's gain over it: what it is, and what more noise of its torque would add."""
    made = pushed(seed, motor_push=motor_push)
    more = noise * np.random.default_rng(seed + 50).standard_normal(len(made))
    log, viscous = data(replace(made, input=made.needed_input + more)), structure("motor_viscous")
    found = fit_disturbed(viscous, log, (), ("cubic",), THRESHOLDS, with_play=False)
    place = found.fitted.names.index("beta1")
    change = pulled(found.fitted, found.sizes, log.samples, found.factor)[place]
    return found.fitted.by_name["beta1"] / PUSHED["beta1"] - 1.0, change / PUSHED["beta1"]


@pytest.mark.parametrize("seed", [1, 2])
def test_a_noisy_torque_takes_the_gain_for_too_small(seed):
    """Assert that the error of a gain is foretold by what as much noise again would do to it."""
    error, foretold = gain(seed, 1.44)
    assert error < -0.05
    assert 0.5 * error > foretold > 1.5 * error


@pytest.mark.parametrize(("noise", "push"), [(0.0, 2.0), (0.24, 0.0)])
def test_what_is_no_noise_of_a_torque_pulls_nothing(noise, push):
    """Assert that neither a push of the motor nor a noise that few samples show moves a gain."""
    assert abs(gain(1, noise, push)[1]) < 1e-3


def late(recording: Recording) -> Fitted:
    """The joint of a recording, with a delay of its input."""
    sought = replace(PAPER, timing=Timing("cubic", sought=(INPUT,)))
    return fit_to(sought, data(recording), {**COEFFICIENTS, INPUT: 1e-3}, 1.0)[0]


@cache
def behind_a_lag(noise: float) -> Fitted:
    """The same where the torque lags by 6 ms behind its record."""
    recording = made(1, noise=noise)
    torque = recording.needed_input
    ahead = torque + 6e-3 * np.gradient(torque, SAMPLE_TIME)
    return late(replace(recording, input=ahead))


@pytest.mark.parametrize(
    ("noise", "share"),
    [
        (3e-4, 1.0),  # the log says that it is a lag
        (3e-2, 3.0**-0.5),  # it does not say
    ],
)
def test_a_lag_in_a_delays_place_has_the_error_that_it_makes(noise, share):
    """Assert the error of the motor's gain, 0.4 % of it, and that the delay has none."""
    place = behind_a_lag(3e-4).names.index("beta1")
    error = COEFFICIENTS["beta1"] - behind_a_lag(3e-4).values[place]
    found = lagged(behind_a_lag(noise))
    assert found[place] == pytest.approx(share * error, rel=0.1)
    assert found[-1] == 0.0


def test_a_delay_is_no_lag():
    """Assert that a log which says so has no such error, nor one without a delay."""
    assert not lagged(late(made(1, input_delay=3e-3))).any()
    recording = made(1)
    torque, times = recording.needed_input, recording.sample_time * np.arange(len(recording))
    early = late(replace(recording, input=np.interp(times - 3e-3, times, torque)))
    assert early.by_name[INPUT] < 0.0
    assert not lagged(early).any()
