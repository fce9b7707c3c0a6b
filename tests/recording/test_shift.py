"""Channels delayed by fractions of a sample."""

import numpy as np
import pytest

from flexid.estimators.channel_timing import invalid_ends, later, rate_of_later

SAMPLE_TIME = 1e-3
TIME = SAMPLE_TIME * np.arange(3000)
SHIFTS = [0.5, -0.5, 0.01, -0.75, 2.3, -7.49, 3.0, -4.0, 0.0]


def motion(time):
    """Return a motion of 20 and 61 rad/s about a constant."""
    return 2.0 + np.sin(20.0 * time) + 0.3 * np.cos(61.0 * time)


@pytest.mark.parametrize("samples", SHIFTS)
def test_motion_is_shifted_by_just_so_much(samples):
    """Assert that a motion of up to 10 Hz is shifted exactly, within the stated margins."""
    first, last = invalid_ends(samples)
    shifted = later(motion(TIME), samples)[first : len(TIME) - last]
    expected = motion(TIME - SAMPLE_TIME * samples)[first : len(TIME) - last]
    assert np.max(np.abs(shifted - expected)) < 1e-6
    assert first + last <= abs(samples) + 65
    if samples == int(samples):
        assert first + last == abs(samples)


@pytest.mark.parametrize("samples", SHIFTS)
def test_white_noise_stays_white(samples):
    """Assert that shifted white noise stays white, with the same variance."""
    noise = np.random.default_rng(1).standard_normal(100_000)
    shifted = later(noise, samples)[100:-100]
    correlation = [np.mean(shifted[lag:] * shifted[: len(shifted) - lag]) for lag in (0, 1, 2, 3)]
    assert correlation == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=0.02)


@pytest.mark.parametrize("samples", [0.5, -1.5, 0.0, 2.2])
def test_it_depends_smoothly_on_the_shift(samples):
    """Assert that the rate equals the derivative by the shift, also at half a sample.

    With a filter that switches there, fits stuck at half a sample and did not converge.
    """
    noisy = motion(TIME) + 0.1 * np.random.default_rng(2).standard_normal(len(TIME))
    step = 1e-4
    apart = later(noisy, samples + step) - later(noisy, samples - step)
    rate = rate_of_later(noisy, samples)
    assert rate == pytest.approx(apart / (2.0 * step), abs=1e-6)
    assert np.ptp(rate) > 0.1


@pytest.mark.parametrize("length", [1, 2, 3, 10, 997])
def test_a_line_of_any_length_stays_one(length):
    """Assert that a straight line is shifted exactly, up to its ends."""
    places = np.arange(length, dtype=np.float64)
    wanted = 3.0 - 0.5 * (places - 0.3) if length > 1 else [3.0]
    assert later(3.0 - 0.5 * places, 0.3) == pytest.approx(wanted)
    assert rate_of_later(3.0 - 0.5 * places, 0.3) == pytest.approx(0.5 if length > 1 else 0.0)
