"""Logs of drives with one encoder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_log import joint_columns, write_csv

from flexid.errors import RecordingError
from flexid.estimators.samples import rigid_samples, samples_of_recording
from flexid.recording import Recording, read_log, with_velocities

PENDULUM_MAP = """
motor_position = {column = "position", unit = "rad"}
motor_velocity = {column = "velocity", unit = "rad/s"}
motor_torque = {column = "torque", unit = "N·m"}
"""


def one_encoder(**extra: np.ndarray) -> dict[str, np.ndarray]:
    """Columns without the link's."""
    columns = joint_columns()
    return {**{c: v for c, v in columns.items() if not c.startswith("link")}, **extra}


def test_motor_alone(tmp_path: Path):
    """Assert that a log of the motor alone is read, and what it is good for is said."""
    log = read_log(write_csv(tmp_path, one_encoder()))
    (recording,) = log.recordings
    assert recording.link_position is None
    np.testing.assert_allclose(recording.motor_position, joint_columns()["motor_position"])
    assert len(recording) == 400
    (warning,) = log.warnings
    for words in ("no link_position", "only the rigid joint", "in a column map"):
        assert words in warning


def test_misspelt_link_position(tmp_path: Path):
    """Assert that a link encoder under another name is pointed out."""
    columns = one_encoder(lnk_position=joint_columns()["link_position"])
    warnings = " ".join(read_log(write_csv(tmp_path, columns)).warnings)
    assert "did you mean 'lnk_position'?" in warnings


def test_velocity_without_position(tmp_path: Path):
    """Assert that a link velocity alone is left out, and said to be."""
    columns = one_encoder(link_velocity=joint_columns()["link_velocity"])
    log = read_log(write_csv(tmp_path, columns))
    assert log.recordings[0].link_velocity is None
    assert any("link_velocity is not used" in warning for warning in log.warnings)


def test_motor_in_degrees_without_unit(tmp_path: Path):
    """Assert that the speed of a single encoder is checked too."""
    columns = one_encoder()
    columns["motor_position"] = np.degrees(columns["motor_position"])
    del columns["motor_velocity"]
    with pytest.raises(RecordingError, match=r"faster than a joint.*motor_position \[deg\]"):
        read_log(write_csv(tmp_path, columns))


def test_several_channels_missing(tmp_path: Path):
    """Assert that where the log cannot be used at all, the link position is asked for too."""
    columns = one_encoder()
    del columns["motor_torque"]
    with pytest.raises(RecordingError, match=r"no link_position .*, no motor_torque"):
        read_log(write_csv(tmp_path, columns))


@pytest.fixture
def recording() -> Recording:
    """Return a motor's motion without a link."""
    time = 0.01 * np.arange(300)
    return Recording(0.01, 2.0, None, np.sin(time), np.cos(time), "N m", source="arm.csv")


def test_no_deflection(recording: Recording):
    """Assert that whoever asks for the link is told what is missing, in which file."""
    with pytest.raises(RecordingError, match=r"arm\.csv: link_position: .*log it, or identify"):
        _ = recording.deflection
    with pytest.raises(RecordingError, match="rigid joint"):
        samples_of_recording(recording)


def test_velocities_and_window(recording: Recording):
    """Assert that the motor's velocity is derived and a window keeps the link absent."""
    part = with_velocities(recording).window(100, 200)
    assert part.link_position is None
    assert part.link_velocity is None
    assert part.motor_velocity is not None
    np.testing.assert_allclose(part.motor_velocity, np.cos(part.time - 2.0), atol=1e-6)


def test_samples_of_the_rigid_joint(recording: Recording):
    """Assert that the rigid joint has the motor's position as its only coordinate."""
    samples = rigid_samples(recording)
    assert samples.positions.shape == (300, 1)
    assert samples.velocities is None
    np.testing.assert_array_equal(samples.positions[:, 0], recording.motor_position)
    velocities = rigid_samples(with_velocities(recording)).velocities
    assert velocities is not None
    assert velocities.shape == (300, 1)


def test_rigid_pendulum(shared_data: Path, tmp_path: Path):
    """Assert that the pendulum of DFKI is read, with a middle dot in its torque's unit."""
    columns = tmp_path / "columns.toml"
    columns.write_text(PENDULUM_MAP, encoding="utf-8")
    log = read_log(shared_data / "dfki-pendulum" / "ddp.csv", columns)
    (recording,) = log.recordings
    assert not any("did you mean" in warning for warning in log.warnings)  # position is taken
    assert recording.sample_time == pytest.approx(0.002, rel=2e-3)
    assert recording.input_unit == "N m"
    assert recording.link_position is None
    assert recording.motor_velocity is not None
