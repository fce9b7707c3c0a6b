"""Channels moved by parts of a sample."""

import numpy as np
import pytest

from flexid.recording.shift import later, spoilt

SAMPLE_TIME = 1e-3
TIME = SAMPLE_TIME * np.arange(3000)
SHIFTS = [0.5, -0.5, 0.01, -0.75, 2.3, -7.49, 3.0, -4.0, 0.0]


def motion(time):
    """Return a motion of 20 and 61 rad/s about a constant."""
    return 2.0 + np.sin(20.0 * time) + 0.3 * np.cos(61.0 * time)


@pytest.mark.parametrize("samples", SHIFTS)
def test_motion_is_shifted_by_just_so_much(samples):
    """Assert that a motion of up to 10 Hz is shifted exactly, and no more spoilt than said."""
    first, last = spoilt(samples)
    shifted = later(motion(TIME), samples)[first : len(TIME) - last]
    expected = motion(TIME - SAMPLE_TIME * samples)[first : len(TIME) - last]
    assert np.max(np.abs(shifted - expected)) < 1e-7
    assert first + last <= abs(samples) + 40
    if samples == int(samples):
        assert first + last == abs(samples)


@pytest.mark.parametrize("samples", SHIFTS)
def test_white_noise_stays_white(samples):
    """Assert that neighbouring samples of shifted noise stay independent, its size the same."""
    noise = np.random.default_rng(1).standard_normal(100_000)
    shifted = later(noise, samples)[100:-100]
    correlation = [np.mean(shifted[lag:] * shifted[: len(shifted) - lag]) for lag in (0, 1, 2, 3)]
    assert correlation == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=0.02)
