"""Wraps of an encoder before a gear, for fast motors and streams with lost samples."""

import numpy as np
import pytest
from moving_joint import counted

from flexid.arrays import FloatArray
from flexid.recording.jumps import without_wraps
from flexid.streaming.guard import Guard
from flexid.streaming.options import WatchOptions

H = 0.01
TURN = 0.1


def moved(peak: float, count: int = 900) -> FloatArray:
    """Return positions of a motor from rest, with at most this many turns per sample."""
    rate = 2.0 * np.pi / 300.0
    noise = 1e-3 * np.random.default_rng(1).standard_normal(count)
    return TURN * (peak / rate * (1.0 - np.cos(rate * np.arange(count))) + noise)


CLOCK: FloatArray = np.asarray(H * np.arange(900), dtype=np.float64)
GUARD = Guard(WatchOptions(H, (), "rigid", filter_rate=5.0, motor_turn=TURN))


@pytest.mark.parametrize("turns", [1, 4])
@pytest.mark.parametrize("peak", [0.2, 0.3, 0.45, 0.7])
def test_a_fast_motor(peak: float, turns: int):
    """Assert that no turn is lost, for fast motion and missing samples."""
    position = moved(peak)
    kept = np.random.default_rng(2).random(len(position)) >= 0.02
    time, readings = CLOCK[kept], np.mod(position, turns * TURN)[kept]
    found, period = without_wraps(time, readings, TURN)
    assert np.ptp((found - position[kept])[1:]) < 1e-9
    assert period == pytest.approx(turns * TURN)
    counts = counted(GUARD, time, readings)
    assert counts.wraps > 20 * peak


@pytest.mark.parametrize("peak", [0.3, 0.7])
def test_a_fast_motor_whose_encoder_does_not_wrap(peak: float):
    """Assert that an encoder without wraps is unchanged, at any speed from its first sample."""
    readings = moved(peak)[75:]
    found, period = without_wraps(CLOCK[75:], readings, TURN)
    np.testing.assert_array_equal(found, readings)
    counts = counted(GUARD, CLOCK[75:], readings)
    assert (period, counts.wraps) == (0.0, 0)


def test_what_only_looks_like_a_wrap():
    """Assert turns despite single outliers, and none if the readings exceed a turn."""
    position = moved(0.3)
    readings = np.mod(position, TURN)
    bad = np.arange(10, 880, 20)
    off = np.resize([0.2, -0.2, 0.15, 0.3, 0.5, -0.4], len(bad))
    readings[bad] = np.mod(position[bad] + TURN * off, TURN)
    found, _ = without_wraps(CLOCK, readings, TURN)
    assert np.ptp(np.delete(found - position, bad)[1:]) < 1e-9
    readings = np.array([0.0, 0.1, 0.105, 0.12, 0.13, 0.14])
    found, period = without_wraps(CLOCK[:6], readings, 0.1)
    np.testing.assert_array_equal(found, readings)
    assert period == 0.0
