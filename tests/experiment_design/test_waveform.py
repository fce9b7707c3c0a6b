"""Tones that begin and end at rest."""

import numpy as np
import pytest

from flexid.experiment_design.waveform import waveform

TONES = waveform(duration=5.0, sample_time=1e-3, ramp=0.5, highest_frequency=30.0, harmonics=6)
WEIGHTS = np.random.default_rng(1).standard_normal(12)


def test_begins_and_ends_at_rest():
    """Assert that signal and rate vanish at both ends, and do not in between."""
    for values in (TONES.signal(WEIGHTS), TONES.rate(WEIGHTS)):
        assert np.abs(values[[0, -1]]).max() < 1e-12 * np.abs(values).max()


def test_rate_is_the_derivative():
    """Assert that the rate is the derivative of the signal, ramps included."""
    slope = np.gradient(TONES.signal(WEIGHTS), TONES.time, edge_order=2)
    assert np.abs(slope - TONES.rate(WEIGHTS)).max() < 1e-3 * np.abs(slope).max()


def test_tones_are_whole_periods():
    """Assert that all tones differ, fit the experiment and reach the highest frequency asked."""
    periods = TONES.angular_frequencies * 5.0 / (2 * np.pi)
    np.testing.assert_allclose(periods, np.rint(periods), atol=1e-9)
    assert len(np.unique(np.rint(periods))) == 6
    assert TONES.angular_frequencies[-1] == pytest.approx(30.0, abs=2 * np.pi / 5.0)
