"""Band of a joint: low-pass filtering and thinning of a log."""

from dataclasses import replace

import numpy as np
import pytest

from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import RESTING
from flexid.identification.estimation import band, thinned_log
from flexid.identification.full_model.model import Data
from flexid.identification.structure.link_delay import shifted
from flexid.recording.velocities import position_noise

RESONANCE = 20.0  # rad/s
START = {"theta2": 100.0, "alpha1": 300.0}
PERIOD = 2.0 * np.pi / RESONANCE


def log_of(position: np.ndarray, rate: float, torque: np.ndarray | None = None) -> Data:
    """Return data whose link and motor move alike."""
    positions = np.column_stack((position, position))
    torque = np.zeros(len(position)) if torque is None else torque
    velocities = np.gradient(positions, 1.0 / rate, axis=0)
    samples = Samples(positions, velocities, torque[:, None], 1.0 / rate)
    noise = np.array([position_noise(column) for column in positions.T])
    return Data((samples,), (0,), noise)


def sine(frequency: float, rate: float, duration: float = 20.0) -> np.ndarray:
    """Return a sine of unit amplitude; frequency in rad/s."""
    return np.sin(frequency * np.arange(round(duration * rate)) / rate)


def middle(values: np.ndarray, share: float = 0.1) -> np.ndarray:
    """Return the values without both ends."""
    cut = int(share * len(values))
    return values[cut:-cut]


def test_the_band_keeps_the_resonance_and_rejects_what_lies_above():
    """Assert an error of 0.5 % at the resonance, and 1 % left above the new Nyquist frequency."""
    position = sine(RESONANCE, 1000.0)
    data = log_of(position, 1000.0, position)
    samples = replace(data.samples[0], velocities=np.column_stack((position, position)))
    factor = thinned_log.thinning(data, START)
    assert factor > 10
    found = thinned_log.thinned(replace(data, samples=(samples,)), factor, held=False).samples[0]
    assert found.velocities is not None
    for column in (*found.velocities.T, found.positions[:, 1], found.inputs[:, 0]):
        np.testing.assert_allclose(column, found.positions[:, 0], rtol=0.0, atol=1e-12)
    angle = RESONANCE * factor / 1000.0 * np.arange(len(found))
    basis = np.column_stack((np.sin(angle), np.cos(angle)))
    sine_part, cosine_part = np.linalg.lstsq(middle(basis), middle(found.positions[:, 0]))[0]
    assert abs(np.arctan2(cosine_part, sine_part)) < 1e-3
    assert np.hypot(sine_part, cosine_part) == pytest.approx(1.0, abs=5e-3)
    beyond = log_of(sine(1.3 * np.pi * 1000.0 / factor, 1000.0), 1000.0)
    rejected = thinned_log.thinned(beyond, factor, held=False).samples[0].positions
    assert np.abs(middle(rejected)).max() < 0.01


@pytest.mark.parametrize("rate", [250.0, 1000.0, 4000.0])
def test_thinning_leaves_sixteen_samples_in_a_period(rate):
    """Assert at least 16 samples per period of the resonance, with the largest integer factor."""
    factor = thinned_log.thinning(log_of(sine(3.0, rate), rate), START)
    assert factor * 16.0 <= PERIOD * rate < (factor + 1) * 16.0


def test_slow_and_short_logs_keep_enough_samples():
    """Assert that a log with fewer samples per period is kept, and that 200 samples are left."""
    slow = log_of(sine(3.0, 40.0), 40.0)
    assert thinned_log.thinning(slow, START) == 1
    assert thinned_log.thinned(slow, 1, held=True) is slow
    assert thinned_log.thinning(log_of(sine(3.0, 1000.0, 2.0), 1000.0), {"theta2": 1.0}) == 10
    # A short recording limits the factor by its own halves alone.
    long, short = (log_of(sine(3.0, 1000.0, length), 1000.0) for length in (20.0, 0.4))
    both = replace(long, samples=(*long.samples, *short.samples))
    assert [thinned_log.thinning(own, {"theta2": 1.0}) for own in (long, both)] == [100, 10]


def test_a_held_input_is_the_mean_of_before_and_after():
    """Assert that the mean of a held input's steps before and after a sample acts at that sample.

    Held from sample to sample, u(k) = k acts as k - 1/2 at sample k on average. The low-pass
    preserves straight lines.
    """
    ramp = np.arange(20000.0)
    data = log_of(sine(RESONANCE, 1000.0), 1000.0, ramp)
    factor = thinned_log.thinning(data, START)
    for held, late in ((True, 0.5), (False, 0.0)):
        found = middle(thinned_log.thinned(data, factor, held=held).samples[0].inputs)
        assert found[:, 0] == pytest.approx(middle(ramp[::factor, None])[:, 0] - late, abs=1e-6)


def test_only_the_deflection_of_a_deflection_sensor_is_late():
    """Assert that a link that moves with its motor is not moved earlier by a late deflection."""
    log = log_of(sine(2.0, 500.0), 500.0)
    (samples,) = log.samples
    (of_link,) = shifted(log, 0.01).samples
    (of_deflection,) = shifted(replace(log, relative_to={"link": "motor"}), 0.01).samples
    assert of_deflection.positions == pytest.approx(samples.positions)
    assert np.abs(of_link.positions - samples.positions).max() == pytest.approx(0.02, rel=0.01)


def test_directions_follow_motion_and_not_noise():
    """Assert that directions follow motion, and spread evenly from -1 to 1 (0.58 RMS) in noise."""
    time = np.arange(5000) / 1000.0
    noise = 1e-4 * np.random.default_rng(1).standard_normal(40_000)
    for sign in (1.0, -1.0):
        data = log_of(sign * time + noise[:5000], 1000.0)
        found = thinned_log.directions(data.samples, 19)
        assert len(found) == len(data.samples[0].positions[::19])
        assert middle(found) == pytest.approx(sign, abs=1e-6)
    found = thinned_log.directions(log_of(noise, 1000.0).samples, 19)
    assert abs(found.mean()) < 0.05
    assert found.std() < 0.6
    hidden = log_of(sine(2.0, 1000.0) + 30.0 * noise[:20_000], 1000.0)
    assert not (thinned_log.directions(hidden.samples, 10) == RESTING).any()


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_a_row_rests_where_it_is_slow(noise):
    """Assert that a row counts as resting at a stop and at a reversal, and nowhere else."""
    rate, factor = 1000.0, 10
    speed = 1.0 * np.cos(2.0 * np.arange(6284) / rate)
    stop = 785  # where the velocity is reversed
    speed = np.concatenate((speed[:stop], np.zeros(800), speed[stop:]))
    position = np.cumsum(speed) / rate
    position += noise * np.random.default_rng(3).standard_normal(len(position))
    found = thinned_log.directions(log_of(position, rate).samples, factor)[:, 0] == RESTING
    usual = np.sqrt(np.mean(speed**2))
    slow, fast = (np.abs(speed[::factor]) < share * usual for share in (0.07, 0.13))
    within = np.convolve(slow, np.ones(3), "same") > 2.5  # the whole interval and its neighbours
    assert within.sum() > 80
    assert found[within].all()
    assert not found[np.convolve(~fast, np.ones(3), "same") > 2.5].any()


@pytest.mark.parametrize(("rigid", "share"), [(True, 1.0), (False, 0.25)])
def test_slowest_disturbance_follows_the_resonance(rigid, share):
    """Assert a slowest disturbance at the resonance (rigid joint), or a fourth of it (spring)."""
    data = log_of(sine(RESONANCE, 1000.0), 1000.0)
    own = thinned_log.thinned(data, thinned_log.thinning(data, START), held=False)
    assert band.slowest_disturbance(own, rigid=rigid) == pytest.approx(share * RESONANCE, rel=0.05)
