"""Reading logs that can be used."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from joint_log import csv_text, joint_columns, write_csv

from flexid.errors import RecordingError
from flexid.recording import Log, read_log

CHANNELS = ("link_position", "motor_position", "link_velocity", "motor_velocity", "input")


def assert_equal_logs(a: Log, b: Log, rtol: float = 0.0) -> None:
    """Assert that two logs hold the same recordings, up to `rtol`."""
    assert len(a.recordings) == len(b.recordings)
    for one, other in zip(a.recordings, b.recordings, strict=True):
        assert one.sample_time == pytest.approx(other.sample_time, rel=1e-12)
        assert one.start_time == pytest.approx(other.start_time, rel=1e-12)
        assert one.input_unit == other.input_unit
        for name in CHANNELS:
            np.testing.assert_allclose(
                getattr(one, name), getattr(other, name), rtol=rtol, atol=rtol
            )


def test_canonical_csv(tmp_path: Path) -> None:
    """Assert that every channel arrives bit for bit, with the file's name and digest."""
    columns = joint_columns()
    path = write_csv(tmp_path, columns)
    log = read_log(path)
    assert log.warnings == ()
    assert log.source == str(path)
    assert log.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(0.005, rel=1e-12)
    assert recording.start_time == 0.0
    assert recording.input_unit == "N m"
    np.testing.assert_array_equal(recording.input, columns["motor_torque"])
    for name in CHANNELS[:-1]:
        np.testing.assert_array_equal(getattr(recording, name), columns[name])


def test_parquet_equals_csv(tmp_path: Path) -> None:
    """Assert that a Parquet file and a CSV file with the same columns give the same log."""
    columns = joint_columns()
    pl.DataFrame(columns).write_parquet(tmp_path / "log.parquet")
    assert_equal_logs(read_log(tmp_path / "log.parquet"), read_log(write_csv(tmp_path, columns)))


def test_integer_parquet(tmp_path: Path) -> None:
    """Assert that integers with a unit are read as numbers."""
    columns = joint_columns()
    frame = pl.DataFrame(columns).with_columns(
        pl.Series("time [ms]", 5 * np.arange(len(columns["time"])))
    )
    frame.drop("time").write_parquet(tmp_path / "log.parquet")
    assert read_log(tmp_path / "log.parquet").recordings[0].sample_time == pytest.approx(0.005)


def test_degrees_equal_radians(tmp_path: Path) -> None:
    """Assert that the unit in the header makes degrees and milliseconds equal to SI."""
    columns = joint_columns()
    degrees = {
        "time [ms]": columns["time"] * 1e3,
        "link_position [deg]": np.degrees(columns["link_position"]),
        "motor_position [deg]": np.degrees(columns["motor_position"]),
        "link_velocity [deg/s]": np.degrees(columns["link_velocity"]),
        "motor_velocity [rpm]": columns["motor_velocity"] * 30.0 / np.pi,
        "motor_torque [mN m]": columns["motor_torque"] * 1e3,
    }
    in_degrees = read_log(write_csv(tmp_path, degrees, "degrees.csv"))
    assert in_degrees.warnings == ()
    assert_equal_logs(in_degrees, read_log(write_csv(tmp_path, columns)), rtol=1e-12)


def test_deflection_gives_the_link_position(tmp_path: Path) -> None:
    """Assert that link = motor + deflection where the link is not measured."""
    columns = joint_columns()
    link = columns.pop("link_position")
    columns["deflection"] = link - columns["motor_position"]
    (recording,) = read_log(write_csv(tmp_path, columns)).recordings
    np.testing.assert_allclose(recording.needed_link_position, link, atol=1e-15)


def test_velocities_may_be_missing(tmp_path: Path) -> None:
    """Assert that a velocity that was not measured is None."""
    columns = joint_columns()
    del columns["link_velocity"]
    (recording,) = read_log(write_csv(tmp_path, columns)).recordings
    assert recording.link_velocity is None
    assert recording.motor_velocity is not None


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("motor_torque", "N m"),
        ("motor_torque [Nm]", "N m"),
        ("motor_torque [V]", "V"),
        ("motor_torque [mA]", "A"),
        ("motor_current", "A"),
        ("motor_voltage", "V"),
    ],
)
def test_kinds_of_input(tmp_path: Path, header: str, unit: str) -> None:
    """Assert that the input's name and unit say what kind it is."""
    columns = joint_columns()
    columns[header] = columns.pop("motor_torque")
    assert read_log(write_csv(tmp_path, columns)).recordings[0].input_unit == unit


def test_torque_is_preferred_to_current(tmp_path: Path) -> None:
    """Assert that of two inputs the torque is used and the other is named in a warning."""
    columns = joint_columns()
    columns["motor_current"] = 2.0 * columns["motor_torque"]
    log = read_log(write_csv(tmp_path, columns))
    np.testing.assert_array_equal(log.recordings[0].input, columns["motor_torque"])
    assert len(log.warnings) == 1
    assert "motor_current is not used" in log.warnings[0]


def test_unused_columns_are_named(tmp_path: Path) -> None:
    """Assert that a column with an unknown name is ignored with a warning, text or not."""
    text = csv_text(joint_columns()).splitlines()
    path = tmp_path / "log.csv"
    path.write_text("\n".join([text[0] + ",note", *(line + ",idle" for line in text[1:])]))
    log = read_log(path)
    assert len(log.warnings) == 1
    assert "'note' not used" in log.warnings[0]


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace(",", " , "),
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\ufeff" + text,
        lambda text: "\n\n" + text,
        lambda text: text + "\n\n\n",
        lambda text: '"' + text.replace("\n", '"\n"').replace(",", '","').removesuffix('"'),
    ],
    ids=["semicolons", "tabs", "spaces", "crlf", "cr", "bom", "blank before", "after", "quotes"],
)
def test_dialects(tmp_path: Path, change: Callable[[str], str]) -> None:
    """Assert that other separators, line ends and quotes change nothing."""
    columns = joint_columns()
    path = tmp_path / "other.csv"
    path.write_bytes(change(csv_text(columns)).encode())
    assert_equal_logs(read_log(path), read_log(write_csv(tmp_path, columns)))


def test_lines_are_counted_as_an_editor_does(tmp_path: Path) -> None:
    """Assert that blank lines before the header count."""
    lines = csv_text(joint_columns()).splitlines()
    lines[20] = "oops" + lines[20]
    path = tmp_path / "log.csv"
    path.write_text("\n\n" + "\n".join(lines))
    with pytest.raises(RecordingError, match="line 23, column 'time'"):
        read_log(path)


def read_real(tmp_path: Path, log: Path, column_map: str) -> Log:
    """Read a log with a column map given as text."""
    map_path = tmp_path / "columns.toml"
    map_path.write_text(column_map)
    return read_log(log, map_path)


def test_flexible_arm(tmp_path: Path, shared_data: Path) -> None:
    """Assert that a rig's raw sensor columns become angles without a warning."""
    log = read_real(
        tmp_path,
        shared_data / "ist-flexible-arm" / "ist_square_1p5V.csv",
        """
        time = {column = "t_s", unit = "s"}
        motor_position = {column = "pot_V", scale = 35.32, unit = "deg"}
        deflection = {column = "strain_V", scale = 1.34, unit = "deg"}
        motor_voltage = {column = "u_V", unit = "V"}
        """,
    )
    assert log.warnings == ()
    (recording,) = log.recordings
    assert len(recording) == 2001
    assert recording.sample_time == pytest.approx(0.01)
    assert recording.input_unit == "V"
    assert recording.motor_position[0] == pytest.approx(np.radians(35.32 * 2.128906))
    assert recording.deflection[0] == pytest.approx(np.radians(1.34 * -0.1123047))


@pytest.mark.parametrize("axis", [1, 2, 3])
@pytest.mark.parametrize("file", ["kr300_A.csv", "kr300_B.csv"])
def test_industrial_robot(tmp_path: Path, shared_data: Path, file: str, axis: int) -> None:
    """Assert that an axis with its velocities reads without a warning."""
    log = read_real(
        tmp_path,
        shared_data / "kr300" / file,
        f"""
        time = "t_s"
        link_position = {{column = "a{axis}_q_link_deg", unit = "deg"}}
        link_velocity = {{column = "a{axis}_qd_link_deg_s", unit = "deg/s"}}
        motor_position = {{column = "a{axis}_q_mot_deg", unit = "deg"}}
        motor_velocity = {{column = "a{axis}_qd_mot_deg_s", unit = "deg/s"}}
        motor_torque = {{column = "a{axis}_tau_mot_Nm", unit = "N m"}}
        """,
    )
    assert log.warnings == ()
    assert len(log.recordings[0]) == 2501
    assert log.recordings[0].sample_time == pytest.approx(0.004)
    assert log.recordings[0].link_velocity is not None
