"""Wraps of an encoder in front of a gear, of a motor that is fast and of a stream with losses."""

import numpy as np
import pytest

from flexid.streaming.gear_wraps import GearWraps

H = 0.01
TURN = 0.1
MOTOR = 2


def moved(peak: float, count: int = 900) -> np.ndarray:
    """Positions of a motor that begins at rest and makes so many turns in a sample at most."""
    rate = 2.0 * np.pi / 300.0
    noise = 1e-3 * np.random.default_rng(1).standard_normal(count)
    return TURN * (peak / rate * (1.0 - np.cos(rate * np.arange(count))) + noise)


def samples_of(position: np.ndarray) -> np.ndarray:
    """Them, beside a clock."""
    samples = np.zeros((len(position), 4))
    samples[:, 0] = H * np.arange(len(position))
    samples[:, MOTOR] = position
    return samples


@pytest.mark.parametrize("turns", [1, 4])
@pytest.mark.parametrize("peak", [0.2, 0.3, 0.45, 0.7])
def test_a_fast_motor(peak: float, turns: int):
    """Assert that no turn is lost, however many of them a sample holds, nor where samples are."""
    position = moved(peak)
    kept = np.random.default_rng(2).random(len(position)) >= 0.02
    samples = samples_of(np.mod(position, turns * TURN))[kept]
    wraps = GearWraps(TURN, H, MOTOR)
    apart = wraps.undone(samples)[:, MOTOR] - position[kept]
    assert np.ptp(apart[1:]) < 1e-9
    assert wraps.wraps > 20 * peak
    assert wraps.unclear == 0


def test_outliers_lead_no_turn_astray():
    """Assert that single ones, within and beyond a quarter of a turn, leave the others."""
    position = moved(0.3)
    samples = samples_of(np.mod(position, TURN))
    bad = np.arange(10, 880, 20)
    off = np.resize([0.2, -0.2, 0.15, 0.3, 0.5, -0.4], len(bad))
    samples[bad, MOTOR] = np.mod(position[bad] + TURN * off, TURN)
    wraps = GearWraps(TURN, H, MOTOR)
    apart = np.delete(wraps.undone(samples)[:, MOTOR] - position, bad)
    assert np.ptp(apart[1:]) < 1e-9
    assert wraps.unclear == 0


@pytest.mark.parametrize("peak", [0.3, 0.7])
def test_a_fast_motor_whose_encoder_does_not_wrap(peak: float):
    """Assert that nothing is taken off it, at any speed from its first sample on."""
    samples = samples_of(moved(peak)[75:])
    wraps = GearWraps(TURN, H, MOTOR)
    np.testing.assert_array_equal(wraps.undone(samples), samples)
    assert (wraps.wraps, wraps.unclear) == (0, 0)


@pytest.mark.parametrize(
    ("peak", "lost", "unclear"),
    [
        (0.2, slice(0, 75), 0),
        (0.3, slice(0, 75), 1),
        (0.2, slice(275, 277), 0),
        (0.2, slice(275, 285), 1),
        (0.3, slice(360, 375), 2),
    ],
)
def test_what_cannot_be_known_is_counted(peak: float, lost: slice, unclear: int):
    """Assert that a gap is, and a speed above a quarter of a turn that nothing led up to."""
    samples = np.delete(samples_of(np.mod(moved(peak), TURN)), lost, axis=0)
    wraps = GearWraps(TURN, H, MOTOR)
    wraps.undone(samples)
    assert wraps.unclear == unclear


@pytest.mark.parametrize(("odd", "count", "unclear"), [(1, 9, 0), (2, 2, 0), (2, 3, 1), (3, 3, 1)])
def test_readings_that_are_odd_again_and_again(odd: int, count: int, unclear: int):
    """Assert that one is an outlier, and that after two the turns cannot be known."""
    position = moved(0.2)
    position[400 : 400 + odd] += 0.4 * TURN
    wraps = GearWraps(TURN, H, MOTOR)
    wraps.undone(samples_of(np.mod(position, TURN))[: 400 + count])
    assert wraps.unclear == unclear


def test_a_repeated_sample_says_no_speed():
    """Assert that a reading which comes twice, with other noise, changes no turn."""
    position = moved(0.3)
    samples = samples_of(np.mod(position, TURN))
    twice = np.repeat(np.arange(50, 800, 3), 2)
    again = np.insert(samples, twice, samples[twice - 1], axis=0)
    repeats = np.insert(np.zeros(len(samples), bool), twice, True)
    again[repeats, 0] += np.resize([1e-5, 2e-5], len(twice))
    wraps = GearWraps(TURN, H, MOTOR)
    apart = (wraps.undone(again)[:, MOTOR])[~repeats] - position
    assert np.ptp(apart[1:]) < 1e-9
    assert wraps.unclear == 0


@pytest.mark.parametrize("speed", [0.3, 1.0 / 3.0])
def test_a_motor_that_is_stopped_at_once(speed: float):
    """Assert that turns which may have been lost are counted, once more while it is believed."""
    to_speed = moved(speed, 76)
    steady = to_speed[-1] + TURN * speed * np.minimum(np.arange(1, 400), 200)
    samples = samples_of(np.mod(np.r_[to_speed, steady], TURN))
    wraps = GearWraps(TURN, H, MOTOR)
    wraps.undone(samples[:270])
    assert wraps.unclear == 0
    wraps.undone(samples[270:])
    assert 1 <= wraps.unclear <= 2
