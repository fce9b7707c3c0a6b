"""Logs of motion alone, without a torque, current or voltage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_log import joint_columns, write_csv

from flexid.errors import RecordingError
from flexid.estimators.samples import link_samples, samples_of_recording
from flexid.recording import read_log, with_velocities


def motion_alone(**extra: np.ndarray) -> dict[str, np.ndarray]:
    """Columns without the motor's torque."""
    columns = joint_columns()
    return {**{c: v for c, v in columns.items() if c != "motor_torque"}, **extra}


def test_read_without_a_word(tmp_path: Path):
    """Assert that two positions are a log, and that nothing is amiss with it."""
    log = read_log(write_csv(tmp_path, motion_alone()))
    (recording,) = log.recordings
    assert recording.input is None
    assert recording.input_unit == ""
    assert len(recording) == 400
    assert log.warnings == ()
    assert with_velocities(recording).window(10, 20).input is None


def test_misspelt_torque(tmp_path: Path):
    """Assert that a column that looks like the torque is pointed out."""
    torque = joint_columns()["motor_torque"]
    log = read_log(write_csv(tmp_path, motion_alone(motor_torqe=torque)))
    assert any("did you mean 'motor_torqe'?" in warning for warning in log.warnings)


def test_one_encoder_and_no_input(tmp_path: Path):
    """Assert that one position alone is refused: nothing drives it that is known."""
    columns = {c: v for c, v in motion_alone().items() if not c.startswith("link")}
    with pytest.raises(RecordingError, match=r"no link_position .*, no motor_torque"):
        read_log(write_csv(tmp_path, columns))


def test_motor_motion_is_the_input_of_the_link(tmp_path: Path):
    """Assert that the link's row takes the motor's position and velocity, measured or derived."""
    (recording,) = read_log(write_csv(tmp_path, motion_alone())).recordings
    samples = link_samples(recording)
    assert recording.motor_velocity is not None
    np.testing.assert_array_equal(samples.inputs[:, 0], recording.motor_position)
    np.testing.assert_array_equal(samples.inputs[:, 1], recording.motor_velocity)
    np.testing.assert_array_equal(samples.positions[:, 0], recording.link_position)
    columns = {c: v for c, v in motion_alone().items() if c != "motor_velocity"}
    (derived,) = read_log(write_csv(tmp_path, columns)).recordings
    inner = slice(20, -20)
    np.testing.assert_allclose(
        link_samples(derived).inputs[inner, 1], recording.motor_velocity[inner], atol=0.05
    )


def test_whole_joint_needs_the_input(tmp_path: Path):
    """Assert that whoever asks for the input is told what is missing, in which file."""
    (recording,) = read_log(write_csv(tmp_path, motion_alone())).recordings
    with pytest.raises(RecordingError, match=r"log\.csv: input: .*identify the link alone"):
        samples_of_recording(recording)
