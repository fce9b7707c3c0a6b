"""The data that reading returns, with or without a link's encoder and an input."""

from dataclasses import replace

import numpy as np
import pytest
from joint_log import assert_words, joint_columns, read_columns, refused, without

from flexid.errors import RecordingError
from flexid.estimators.samples import samples_of_recording
from flexid.recording import Log, Recording, with_velocities

MOTION = without(joint_columns(), "torque")


@pytest.fixture
def recording() -> Recording:
    """Ten samples without link velocity."""
    ramp = np.arange(10.0)
    return Recording(0.1, 5.0, ramp, 2.0 * ramp, -ramp, "V", motor_velocity=ramp + 1.0)


@pytest.fixture
def alone() -> Recording:
    """A motor's motion without a link."""
    time = 0.01 * np.arange(300)
    return Recording(0.01, 2.0, None, np.sin(time), np.cos(time), "N m", source="arm.csv")


def test_windows(recording: Recording) -> None:
    """Assert that a window keeps the clock and shares memory, and lies within."""
    np.testing.assert_allclose(recording.time, 5.0 + 0.1 * np.arange(10))
    np.testing.assert_array_equal(recording.deflection, -np.arange(10.0))
    part = recording.window(3, 7)
    np.testing.assert_allclose(part.time, recording.time[3:7])
    assert np.shares_memory(part.motor_velocity, recording.motor_velocity)
    assert (len(part), part.link_velocity, part.input_unit) == (4, None, "V")
    for start, stop in ((-1, 3), (3, 3), (4, 2), (0, 11)):
        message = refused(recording.window, start, stop)
        assert "choose 0 <= start < stop <= 10" in message
    with pytest.raises(RecordingError, match=r"input: .*\(9,\).*motor's position"):
        replace(recording, input=np.arange(9.0))


def test_a_log_fits_a_line(recording: Recording) -> None:
    """Assert that a recording and a log show what they hold, and not their samples."""
    assert_words(r"10 samples every 0\.1 s.*input \(V\), motor_velocity>", repr(recording))
    assert repr(Log((recording, recording), (), "a.csv", "")) == "<Log a.csv: 1 s, 1 s>"


def test_motion_alone() -> None:
    """Assert that of two positions alone the motor's motion is the input."""
    (recording,) = read_columns(MOTION).recordings
    assert with_velocities(recording).window(10, 20).input is None
    samples = samples_of_recording(recording, "link")
    assert recording.motor_velocity is not None
    np.testing.assert_array_equal(samples.inputs[:, 0], recording.motor_position)
    np.testing.assert_array_equal(samples.inputs[:, 1], recording.motor_velocity)
    np.testing.assert_array_equal(samples.positions[:, 0], recording.link_position)
    (derived,) = read_columns(without(MOTION, "motor_velocity")).recordings
    inner = slice(20, -20)
    np.testing.assert_allclose(
        samples_of_recording(derived, "link").inputs[inner, 1],
        recording.motor_velocity[inner],
        atol=0.05,
    )
    assert_words("input: .*identify the link alone", refused(samples_of_recording, recording))


def test_no_deflection(alone: Recording) -> None:
    """Assert that whoever asks for the link is told what is missing, in which file."""
    words = r"arm\.csv: link_position: .*log it, or identify the rigid joint"
    assert_words(words, refused(lambda: alone.deflection))
    assert_words(words, refused(samples_of_recording, alone))


def test_samples_of_the_rigid_joint(alone: Recording) -> None:
    """Assert that it has the motor's position alone, and its velocity where that is derived."""
    part = with_velocities(alone).window(100, 200)
    assert part.link_position is None
    assert part.link_velocity is None
    assert part.motor_velocity is not None
    np.testing.assert_allclose(part.motor_velocity, np.cos(part.time - 2.0), atol=1e-6)
    samples = samples_of_recording(alone, "rigid")
    assert samples.velocities is None
    np.testing.assert_array_equal(samples.positions, alone.motor_position[:, np.newaxis])
    velocities = samples_of_recording(with_velocities(alone), "rigid").velocities
    assert velocities is not None
    assert velocities.shape == (300, 1)
