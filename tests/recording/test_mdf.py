"""MDF files: what is found in them, and what is refused."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from asammdf import MDF, Signal
from joint_log import joint_columns, refused

from flexid.recording import read_log
from flexid.recording.series import table_of_file, tables_of_file

COLUMNS = joint_columns(200)
TIME = COLUMNS["time"]
ENCODERS = ("motor_position", "link_position")


def signal(name: str, values: np.ndarray, time: np.ndarray = TIME, unit: str = "") -> Signal:
    """A channel with its time stamps."""
    return Signal(values, time, name=name, unit=unit)


def written(path: Path, *groups: list[Signal], version: str = "4.10") -> Path:
    """A file of groups, each with a clock of its own."""
    with MDF(version=version) as file:
        for number, group in enumerate(groups):
            file.append(group, acq_name=f"task{number}", common_timebase=True)
        file.save(path, overwrite=True)
    return path


def encoders() -> list[Signal]:
    """Both encoders, the motor's in degrees."""
    return [
        signal("motor_position", np.degrees(COLUMNS["motor_position"]), unit="deg"),
        signal("link_position", COLUMNS["link_position"], unit="rad"),
    ]


@pytest.mark.parametrize(("version", "name"), [("4.10", "log.mf4"), ("3.30", "log.mdf")])
def test_channels(tmp_path: Path, version: str, name: str):
    """Assert that channels with their units and the clock of their group are a log."""
    torque = [signal("motor_torque", COLUMNS["motor_torque"], unit="Nm")]
    log = read_log(written(tmp_path / name, encoders(), torque, version=version))
    (recording,) = log.recordings
    for channel in ENCODERS:
        np.testing.assert_allclose(getattr(recording, channel), COLUMNS[channel], atol=1e-12)
    np.testing.assert_array_equal(recording.input, COLUMNS["motor_torque"])
    assert recording.sample_time == pytest.approx(0.005)
    assert not log.warnings


def test_clocks_that_differ(tmp_path: Path):
    """Assert that a channel of another rate is brought to the slower clock, with a warning."""
    fast = np.arange(0.0, 1.0, 0.001)
    truth = np.sin(4.0 * fast)
    path = written(tmp_path / "log.mf4", encoders(), [signal("motor_torque", truth, fast)])
    log = read_log(path)
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(0.005)
    assert recording.input is not None
    np.testing.assert_allclose(
        recording.input, np.sin(4.0 * TIME[: len(recording)]), atol=1e-5
    )  # twice the cubic's error over a step: 4**4 * 0.001**4 / 50
    assert "'motor_torque' had time stamps of their own and were interpolated" in log.warnings[0]


@pytest.mark.parametrize("rate", [200, 1000])
@pytest.mark.parametrize(("version", "name"), [("4.10", "log.mf4"), ("3.30", "log.mdf")])
def test_parts_are_the_whole(tmp_path: Path, rate: int, version: str, name: str):
    """Assert that a file is read in parts, of one clock or of two, as it is at once."""
    columns = joint_columns(2000)
    time = columns["time"]
    fast = time if rate == 200 else np.arange(0.0007, 9.9, 1.0 / rate)
    group = [signal(one, columns[one], time) for one in ENCODERS]
    torque = [signal("motor_torque", np.sin(4.0 * fast), fast)]
    groups = [[*group, *torque]] if rate == 200 else [group, torque]
    path = written(tmp_path / name, *groups, version=version)
    parts = [table.frame for table in tables_of_file(path, None, 70)]
    assert {part.height for part in parts[:-1]} == {70}
    assert pl.concat(parts).equals(table_of_file(path, None).frame)


def test_a_clock_that_runs_backwards(tmp_path: Path):
    """Assert that it is refused."""
    late = TIME.copy()
    late[150] = late[149]
    torque = [signal("motor_torque", COLUMNS["motor_torque"], late)]
    path = written(tmp_path / "log.mf4", encoders(), torque)
    assert "time runs backwards or repeats" in refused(read_log, path)


def test_invalid_samples(tmp_path: Path):
    """Assert that samples which the recorder marked as invalid are not taken for numbers."""
    torque = signal("motor_torque", COLUMNS["motor_torque"])
    torque.invalidation_bits = np.arange(200) == 117
    path = written(tmp_path / "log.mf4", [*encoders(), torque])
    words = "'motor_torque': 1 of its 200 samples are marked as invalid"
    assert words in refused(read_log, path)
    tables = tables_of_file(path, None, 50)
    assert [next(tables).frame.height for _ in range(2)] == [50, 50]
    assert "1 of its 50 samples, from 101 on, are marked" in refused(next, tables)


def test_the_same_name_in_two_groups(tmp_path: Path):
    """Assert that channels of one name are told apart by their groups."""
    path = written(tmp_path / "log.mf4", encoders(), encoders(), [signal("tau", TIME)])
    assert "'group 0 task0/motor_position [deg]' (number, 200 values)" in refused(read_log, path)
    names = {one: f"group 1 task1/{one}" for one in ENCODERS}
    (recording,) = read_log(path, {**names, "motor_torque": "tau"}).recordings
    np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])


def test_what_it_holds(tmp_path: Path):
    """Assert that texts are listed with the numbers where a channel is missing."""
    text = Signal(np.array([b"ok"] * 200), TIME, name="state", encoding="utf-8")
    message = refused(
        read_log, written(tmp_path / "log.mf4", [signal("speed", TIME, unit="rpm"), text])
    )
    assert "there is no motor_position" in message
    assert "found 'speed [rpm]' (number, 200 values), 'state' (text, an array or a str" in message


def test_damaged_files(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """Assert that files cut short or overwritten are refused, and that asammdf says nothing."""
    raw = written(tmp_path / "log.mf4", encoders()).read_bytes()
    (tmp_path / "cut.mf4").write_bytes(raw[:200])
    assert "not an MDF file that can be read" in refused(read_log, tmp_path / "cut.mf4")
    (tmp_path / "text.mf4").write_text("time,motor_position\n")
    assert "not an MDF file that can be read" in refused(read_log, tmp_path / "text.mf4")
    (tmp_path / "log.mf4").write_bytes(raw.replace(b"##DG", b"##XX"))
    assert "not an MDF file that can be read" in refused(read_log, tmp_path / "log.mf4")
    assert capfd.readouterr() == ("", "")
