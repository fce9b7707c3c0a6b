"""MDF files: what is found in them, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from asammdf import Signal
from joint_log import refused
from log_files import COLUMNS, in_groups, mdf, signal

from flexid.recording import read_log
from flexid.recording.series import tables_of_file

TIME, TORQUE = COLUMNS["time"], COLUMNS["motor_torque"]
ENCODERS = in_groups()[0]


def test_clocks_that_differ(tmp_path: Path):
    """Assert that a channel of another rate is brought to the slower clock, with a warning."""
    fast = np.arange(0.0, 0.5, 0.001)
    degrees = [signal("motor_position", np.degrees(COLUMNS["motor_position"]), unit="deg")]
    link = [signal("link_position", COLUMNS["link_position"])]
    torque = [signal("motor_torque", np.sin(4.0 * fast), fast)]
    log = read_log(mdf(tmp_path / "log.mf4", [*degrees, *link], torque))
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(0.005)
    np.testing.assert_allclose(recording.motor_position, COLUMNS["motor_position"], atol=1e-12)
    np.testing.assert_allclose(
        recording.needed_input, np.sin(4.0 * TIME[: len(recording)]), atol=1e-5
    )  # twice the cubic's error over a step: 4**4 * 0.001**4 / 50
    assert "'motor_torque' had time stamps of their own and were interpolated" in log.warnings[0]


def test_a_clock_that_runs_backwards(tmp_path: Path):
    """Assert that it is refused."""
    late = TIME.copy()
    late[75] = late[74]
    path = mdf(tmp_path / "log.mf4", ENCODERS, [signal("motor_torque", TORQUE, late)])
    assert "time runs backwards or repeats" in refused(read_log, path)


def test_invalid_samples(tmp_path: Path):
    """Assert that samples which the recorder marked as invalid are not taken for numbers."""
    torque = signal("motor_torque", TORQUE)
    torque.invalidation_bits = np.arange(100) == 57
    path = mdf(tmp_path / "log.mf4", [*ENCODERS, torque])
    words = "'motor_torque': 1 of its 100 samples are marked as invalid"
    assert words in refused(read_log, path)
    tables = tables_of_file(path, None, 25)
    assert "1 of its 25 samples, from 51 on, are marked" in refused(next, tables)


def test_the_same_name_in_two_groups(tmp_path: Path):
    """Assert that channels of one name are told apart by their groups."""
    path = mdf(tmp_path / "log.mf4", ENCODERS, ENCODERS, [signal("tau", TIME)])
    assert "'group 0 task0/motor_position [rad]' (number, 100 values)" in refused(read_log, path)
    names = {one.name: f"group 1 task1/{one.name}" for one in ENCODERS}
    (recording,) = read_log(path, {**names, "motor_torque": "tau"}).recordings
    np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])


def test_what_it_holds(tmp_path: Path):
    """Assert that texts are listed with the numbers where a channel is missing."""
    text = Signal(np.array([b"ok"] * 100), TIME, name="state", encoding="utf-8")
    speed = signal("speed", TIME, unit="rpm")
    message = refused(read_log, mdf(tmp_path / "log.mf4", [speed, text]))
    assert "there is no motor_position" in message
    assert "found 'speed [rpm]' (number, 100 values), 'state' (text, an array or a str" in message


def test_damaged_files(tmp_path: Path, capfd: pytest.CaptureFixture[str]):
    """Assert that files cut short or overwritten are refused, and that asammdf says nothing."""
    path = mdf(tmp_path / "log.mf4", ENCODERS)
    raw = path.read_bytes()
    for damaged in (raw[:200], b"time,motor_position\n", raw.replace(b"##DG", b"##XX")):
        path.write_bytes(damaged)
        assert "not an MDF file that can be read" in refused(read_log, path)
    assert capfd.readouterr() == ("", "")
