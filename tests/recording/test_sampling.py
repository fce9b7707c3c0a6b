"""Gaps and jitter of the time stamps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_log import joint_columns, write_csv
from numpy.typing import NDArray
from test_read import assert_equal_logs

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording import Log, read_log


def rows(columns: dict[str, FloatArray], keep: NDArray[np.intp] | slice) -> dict[str, FloatArray]:
    """Return some rows of all columns."""
    numbers = np.arange(len(columns["time"]))[keep]
    return {name: values[numbers] for name, values in columns.items()}


def test_a_gap_gives_two_recordings(tmp_path: Path) -> None:
    """Assert that both sides of a gap are what two files would have given."""
    columns = joint_columns()
    keep = np.r_[0:150, 190:400]
    log = read_log(write_csv(tmp_path, rows(columns, keep)))
    assert "missing from 0.745 s to 0.95 s" in log.warnings[0]
    assert "2 recordings: record without gaps" in log.warnings[0]
    parts = [
        read_log(write_csv(tmp_path, rows(columns, part), "part.csv")).recordings[0]
        for part in (slice(0, 150), slice(190, 400))
    ]
    assert_equal_logs(log, Log(tuple(parts), (), "", ""))


def test_one_lost_sample_is_a_gap(tmp_path: Path) -> None:
    """Assert that a single lost sample cuts the log."""
    columns = rows(joint_columns(), np.delete(np.arange(400), 100))
    assert [len(recording) for recording in read_log(write_csv(tmp_path, columns)).recordings] == [
        100,
        299,
    ]


def test_short_recordings_are_dropped(tmp_path: Path) -> None:
    """Assert that a recording of fewer than 20 samples is dropped with a warning."""
    columns = rows(joint_columns(), np.r_[0:200, 210:220, 230:400])
    log = read_log(write_csv(tmp_path, columns))
    assert [len(recording) for recording in log.recordings] == [200, 170]
    assert "1.05 s to 1.095 s were dropped, since fewer than 20" in log.warnings[1]


def test_only_short_recordings(tmp_path: Path) -> None:
    """Assert that a log that gaps leave nothing of is refused."""
    keep = np.concatenate([np.arange(start, start + 19) for start in range(0, 380, 25)])
    columns = rows(joint_columns(), keep)
    with pytest.raises(RecordingError, match=r"20 samples in a row|vary between") as caught:
        read_log(write_csv(tmp_path, columns))
    assert "record" in str(caught.value)


def jittered(share: float, count: int = 2000) -> dict[str, FloatArray]:
    """Return a motion sampled at times that are off an even grid by up to `share` of a step."""
    offset = share * 0.005 * np.random.default_rng(7).uniform(-1.0, 1.0, count)
    time = 0.005 * np.arange(count) + offset
    motor = np.sin(2.0 * time)
    link = motor + 0.05 * np.sin(9.0 * time)
    return {
        "time": time,
        "link_position": link,
        "motor_position": motor,
        "motor_torque": np.cos(3.0 * time),
    }


def test_rounded_time_is_even(tmp_path: Path) -> None:
    """Assert that a time printed with few digits changes no sample and gives no warning."""
    columns = jittered(0.0005)
    log = read_log(write_csv(tmp_path, columns))
    assert log.warnings == ()
    np.testing.assert_array_equal(log.recordings[0].needed_link_position, columns["link_position"])
    assert log.recordings[0].sample_time == pytest.approx(0.005, rel=1e-6)


def test_jitter_is_interpolated(tmp_path: Path) -> None:
    """Assert that jitter is removed to 1e-7 rad, where taking it as even would cost 5e-4 rad."""
    columns = jittered(0.08)
    log = read_log(write_csv(tmp_path, columns))
    assert "column 'time'" in log.warnings[0]
    assert "interpolated to even times: record at a fixed rate" in log.warnings[0]
    (recording,) = log.recordings
    exact = np.sin(2.0 * recording.time) + 0.05 * np.sin(9.0 * recording.time)
    assert np.abs(recording.needed_link_position - exact).max() < 1e-7
    taken_as_even = columns["link_position"][: len(exact)]
    assert np.abs(taken_as_even - exact).max() > 5e-4


def test_a_switched_input_does_not_overshoot(tmp_path: Path) -> None:
    """Assert that interpolation leaves a two-level input between its levels."""
    columns = jittered(0.08)
    columns["motor_torque"] = np.sign(columns["motor_torque"])
    (recording,) = read_log(write_csv(tmp_path, columns)).recordings
    assert np.abs(recording.needed_input).max() <= 1.0


def test_an_input_that_changes_by_next_to_nothing(tmp_path: Path) -> None:
    """Assert that a change whose inverse is beyond every number is read without a warning."""
    columns = jittered(0.08)
    columns["motor_torque"] = np.sign(columns["motor_torque"])
    columns["motor_torque"][5:9] = [0.0, 5e-324, 1e-323, 1.5e-323]
    (recording,) = read_log(write_csv(tmp_path, columns)).recordings
    assert np.isfinite(recording.needed_input).all()


def test_uneven_time(tmp_path: Path) -> None:
    """Assert that more jitter is refused with the range of the steps."""
    with pytest.raises(RecordingError, match=r"column 'time': the time steps vary between .* ms: "):
        read_log(write_csv(tmp_path, jittered(0.22)))


@pytest.mark.parametrize("rate", [300.0, 400.0, 450.0, 600.0, 900.0])
def test_whole_milliseconds_are_even(tmp_path: Path, rate: float) -> None:
    """Assert that times that fit an even grid but for their last digit are taken for even.

    No sample is changed; interpolated to even times, positions would be 1e-3 rad off.
    """
    columns = joint_columns(sample_time=1.0 / rate)
    columns["time"] = np.round(columns["time"], 3)
    log = read_log(write_csv(tmp_path, columns))
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(1.0 / rate, rel=1e-4)
    np.testing.assert_array_equal(recording.needed_link_position, columns["link_position"])
    assert len(log.warnings) == 1
    assert "the times are rounded to 1 ms; they fit even steps" in log.warnings[0]
    assert "write the time with more digits" in log.warnings[0]


def test_rounding_hides_no_jitter(tmp_path: Path) -> None:
    """Assert that times that are farther off an even grid than by their last digit are refused."""
    columns = jittered(0.22)
    columns["time"] = np.round(columns["time"], 3)
    with pytest.raises(RecordingError, match=r"the time steps vary between .* ms: "):
        read_log(write_csv(tmp_path, columns))


def test_time_too_coarse(tmp_path: Path) -> None:
    """Assert that a time whose digits do not tell samples apart is refused with the remedy."""
    columns = joint_columns(sample_time=1.0 / 2000.0)
    columns["time"] = np.round(columns["time"], 3)
    with pytest.raises(RecordingError, match="write the time with more digits"):
        read_log(write_csv(tmp_path, columns))


def test_seconds_since_1970(tmp_path: Path) -> None:
    """Assert that a clock with a large offset is read from its beginning, its rounding as even."""
    columns = joint_columns()
    columns["time"] = columns["time"] + 1.7e9
    log = read_log(write_csv(tmp_path, columns))
    assert log.warnings == ()
    assert log.recordings[0].start_time == 0.0
