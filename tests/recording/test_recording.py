"""Recordings, with or without a link's encoder and an input."""

from dataclasses import replace

import numpy as np
import pytest
from joint_log import assert_words, joint_columns, read_columns, refused, without

from flexid.errors import RecordingError
from flexid.estimators.samples import samples_of_recording
from flexid.recording import Log, Recording, with_velocities

MOTION = without(joint_columns(), "torque")


RAMP, TIME = np.arange(10.0), 0.01 * np.arange(300)
RECORDING = Recording(0.1, 5.0, RAMP, 2.0 * RAMP, -RAMP, "V", motor_velocity=RAMP + 1.0)
ALONE = Recording(0.01, 2.0, None, np.sin(TIME), np.cos(TIME), "N m", source="arm.csv")


def test_windows() -> None:
    """Assert that a window keeps the clock, shares memory, and lies within the recording."""
    np.testing.assert_allclose(RECORDING.time, 5.0 + 0.1 * np.arange(10))
    np.testing.assert_array_equal(RECORDING.deflection, -np.arange(10.0))
    part = RECORDING.window(3, 7)
    np.testing.assert_allclose(part.time, RECORDING.time[3:7])
    assert np.shares_memory(part.motor_velocity, RECORDING.motor_velocity)
    assert (len(part), part.link_velocity, part.input_unit) == (4, None, "V")
    for start, stop in ((-1, 3), (3, 3), (4, 2), (0, 11)):
        message = refused(RECORDING.window, start, stop)
        assert "choose 0 <= start < stop <= 10" in message
    with pytest.raises(RecordingError, match=r"input: .*\(9,\).*motor's position"):
        replace(RECORDING, input=np.arange(9.0))


def test_a_log_fits_a_line() -> None:
    """Assert that `repr` of a recording and a log gives a summary in one line."""
    assert_words(r"10 samples every 0\.1 s.*input \(V\), motor_velocity>", repr(RECORDING))
    assert repr(Log((RECORDING, RECORDING), (), "a.csv", "")) == "<Log a.csv: 1 s, 1 s>"


def test_motion_alone() -> None:
    """Assert that without an input the motor's motion drives the link."""
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


def test_no_deflection() -> None:
    """Assert that a request for the missing link names the file and the remedy."""
    words = r"arm\.csv: link_position: .*log it, or identify the rigid joint"
    assert_words(words, refused(lambda: ALONE.deflection))
    assert_words(words, refused(samples_of_recording, ALONE))


def test_samples_of_the_rigid_joint() -> None:
    """Assert that samples of a rigid joint have the motor's position, and a derived velocity."""
    part = with_velocities(ALONE).window(100, 200)
    assert part.link_position is None
    assert part.link_velocity is None
    assert part.motor_velocity is not None
    np.testing.assert_allclose(part.motor_velocity, np.cos(part.time - 2.0), atol=1e-6)
    samples = samples_of_recording(ALONE, "rigid")
    assert samples.velocities is None
    np.testing.assert_array_equal(samples.positions, ALONE.motor_position[:, np.newaxis])
    velocities = samples_of_recording(with_velocities(ALONE), "rigid").velocities
    assert velocities is not None
    assert velocities.shape == (300, 1)
