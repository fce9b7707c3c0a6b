"""Columns that are recognised by the names that they usually have."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_log import joint_columns, write_csv

from flexid.errors import RecordingError
from flexid.recording import read_log
from flexid.recording.names import usual_channel

USUAL = {
    "time": ("t", "t_s", "Time_ms", "timestamp"),
    "link_position": ("q_l", "theta_link", "LoadAngle", "link angle", "q_link_deg"),
    "motor_position": ("q_m", "theta_m", "motor_pos", "qMotor", "pos_motor_deg", "rotor angle"),
    "motor_velocity": ("qd_m", "motor_speed_rpm", "omega_m"),
    "motor_torque": ("tau", "tau_m", "torque", "tau_Nm"),
    "motor_current": ("i_m_A", "motor_current", "current_mA"),
    "motor_voltage": ("u_V", "voltage"),
    "position": ("position", "angle", "q"),
    "velocity": ("velocity", "speed_rpm"),
}
STRANGE = (
    *("x1", "a1_q_link_deg", "tau_l", "link_torque", "i", "u", "temperature", "torque_cmd"),
    *("position_desired", "motor_link_angle", "q_dot_dot", "position[0]", "pot_V", ""),
)


@pytest.mark.parametrize(("channel", "name"), [(c, n) for c, names in USUAL.items() for n in names])
def test_usual_names(channel: str, name: str) -> None:
    """Assert that the name is known for the channel it usually is."""
    found = usual_channel(name)
    assert found is not None
    assert found[0] == channel


@pytest.mark.parametrize("name", STRANGE)
def test_other_names(name: str) -> None:
    """Assert that nothing is made of a name that may mean something else."""
    assert usual_channel(name) is None


def test_a_log_with_usual_names(tmp_path: Path) -> None:
    """Assert that it is read, in the units in its names, and that what was taken is said."""
    columns = joint_columns()
    expected = read_log(write_csv(tmp_path, columns)).recordings[0]
    usual = {
        "t_ms": columns["time"] * 1e3,
        "theta_m_deg": np.degrees(columns["motor_position"]),
        "q_l": columns["link_position"],
        "tau_mNm": columns["motor_torque"] * 1e3,
        "mode": 0.0 * columns["time"],
    }
    log = read_log(write_csv(tmp_path, usual, "usual.csv"))
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(0.005)
    np.testing.assert_allclose(recording.motor_position, expected.motor_position, rtol=1e-12)
    np.testing.assert_allclose(recording.needed_input, expected.needed_input, rtol=1e-12)
    taken, unused = log.warnings
    for words in ("'t_ms' for time in ms", "'theta_m_deg' for motor_position in deg", "check"):
        assert words in taken
    assert "'mode' not used" in unused


def test_own_names_come_first(tmp_path: Path) -> None:
    """Assert that a usual name counts for nothing beside the channel's own."""
    columns = joint_columns()
    columns["tau"] = 2.0 * columns["motor_torque"]
    columns["current"] = 3.0 * columns["motor_torque"]
    columns["theta_m"] = 4.0 * columns["motor_position"]
    log = read_log(write_csv(tmp_path, columns))
    np.testing.assert_array_equal(log.recordings[0].input, columns["motor_torque"])
    np.testing.assert_array_equal(log.recordings[0].motor_position, columns["motor_position"])
    assert "'tau', 'current', 'theta_m' not used" in log.warnings[0]


def test_one_encoder(tmp_path: Path) -> None:
    """Assert that a position without a side is the motor's where there is no other."""
    columns = joint_columns()
    single = {
        "time": columns["time"],
        "position": columns["motor_position"],
        "velocity": columns["motor_velocity"],
        "torque": columns["motor_torque"],
    }
    (recording,) = read_log(write_csv(tmp_path, single)).recordings
    np.testing.assert_array_equal(recording.motor_position, columns["motor_position"])
    assert recording.motor_velocity is not None
    single["link_position"] = columns["link_position"]
    with pytest.raises(RecordingError, match="there is no motor_position"):
        read_log(write_csv(tmp_path, single))


def test_two_usual_names(tmp_path: Path) -> None:
    """Assert that of two columns neither is taken, and both are named."""
    columns = joint_columns()
    columns["theta_m"] = columns.pop("motor_position")
    columns["motor_angle"] = 2.0 * columns["theta_m"]
    with pytest.raises(
        RecordingError, match="'theta_m', 'motor_angle' could each be motor_position"
    ):
        read_log(write_csv(tmp_path, columns))


def test_a_map_leaves_nothing_to_guess(tmp_path: Path) -> None:
    """Assert that with a column map only a channel's own name is taken."""
    columns = joint_columns()
    columns["tau"] = columns.pop("motor_torque")
    path = tmp_path / "columns.toml"
    path.write_text('time = "time"')
    log = read_log(write_csv(tmp_path, columns), path)
    assert log.recordings[0].input is None
    assert any("name 'tau' in the column map" in warning for warning in log.warnings)
