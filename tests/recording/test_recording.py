"""The data that reading returns."""

from __future__ import annotations

import numpy as np
import pytest

from flexid.errors import RecordingError
from flexid.recording import Log, Recording


@pytest.fixture
def recording() -> Recording:
    """Return ten samples without link velocity."""
    ramp = np.arange(10.0)
    return Recording(0.1, 5.0, ramp, 2.0 * ramp, -ramp, "V", motor_velocity=ramp + 1.0)


def test_time(recording: Recording) -> None:
    """Assert that time counts from the start in sample times."""
    np.testing.assert_allclose(recording.time, 5.0 + 0.1 * np.arange(10))
    assert len(recording) == 10


def test_deflection(recording: Recording) -> None:
    """Assert that the deflection is link minus motor."""
    np.testing.assert_array_equal(recording.deflection, -np.arange(10.0))


def test_window(recording: Recording) -> None:
    """Assert that a window keeps the clock and shares memory."""
    part = recording.window(3, 7)
    np.testing.assert_allclose(part.time, recording.time[3:7])
    assert np.shares_memory(part.motor_velocity, recording.motor_velocity)
    assert part.link_velocity is None
    assert part.input_unit == "V"


@pytest.mark.parametrize(("start", "stop"), [(-1, 3), (3, 3), (4, 2), (0, 11)])
def test_window_beyond_the_recording(recording: Recording, start: int, stop: int) -> None:
    """Assert that a window that does not lie within is refused."""
    with pytest.raises(RecordingError, match="choose 0 <= start < stop <= 10"):
        recording.window(start, stop)


def test_channels_of_different_length() -> None:
    """Assert that the channel of the wrong length is named."""
    ramp = np.arange(10.0)
    with pytest.raises(RecordingError, match=r"input: .*\(9,\).*motor's position"):
        Recording(0.1, 0.0, ramp, ramp, ramp[1:], "V")


def test_a_log_fits_a_line(recording: Recording) -> None:
    """Assert that a recording and a log show what they hold, and not their samples."""
    shown = repr(recording)
    assert "10 samples every 0.1 s" in shown
    assert "input (V)" in shown
    assert "link_velocity" not in shown
    assert repr(Log((recording, recording), (), "a.csv", "")) == "<Log a.csv: 1 s, 1 s>"
