"""Logs whose channels make no sense: what is refused, mended or warned of."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from joint_log import joint_columns, write_csv

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording import Log, read_log

Columns = dict[str, FloatArray]


def changed(**channels: Callable[[FloatArray], FloatArray]) -> Columns:
    """Return the synthetic log with some channels changed; 4 s of it."""
    columns = joint_columns(800)
    for name, change in channels.items():
        columns[name] = change(columns[name].copy())
    return columns


def times(factor: float) -> Callable[[FloatArray], FloatArray]:
    """Return a change that scales a channel."""
    return lambda values: factor * values


def positions_only(columns: Columns) -> Columns:
    """Return the columns without velocities."""
    return {name: values for name, values in columns.items() if "velocity" not in name}


DEGREES = 180.0 / np.pi
REFUSED: dict[str, tuple[Columns, list[str]]] = {
    "stuck encoder": (
        changed(motor_position=times(0.0)),
        ["column 'motor_position'", "constant", "encoder is stuck", "record it while it moves"],
    ),
    "no input": (changed(motor_torque=times(0.0)), ["column 'motor_torque'", "nothing drives"]),
    "dead velocity": (changed(link_velocity=times(0.0)), ["link_velocity is constant", "leave"]),
    "one encoder twice": (
        {**changed(), "link_position": changed()["motor_position"]},
        ["'link_position' and 'motor_position'", "one and the same", "log the second encoder"],
    ),
    "degrees without unit": (
        positions_only(changed(link_position=times(3e3), motor_position=times(3e3))),
        ["column 'link_position'", "rad/s, faster than a joint", "link_position [deg]"],
    ),
    "link in degrees": (
        positions_only(changed(link_position=times(DEGREES))),
        ["link position is about 57.3 times the motor", "degrees", "unit in brackets"],
    ),
    "motor in degrees": (
        positions_only(changed(motor_position=times(DEGREES))),
        ["motor position is about 57.3 times the link"],
    ),
    "motor before the gear": (
        positions_only(changed(motor_position=times(100.0), link_position=times(1.0))),
        ["times the link position", "as if by a gear: write the drive's gear_ratio", "column map"],
    ),
    "opposite sign": (
        positions_only(changed(motor_position=times(-1.0))),
        ["opposite directions", "scale one by -1"],
    ),
    "velocity in degrees": (
        changed(motor_velocity=times(DEGREES)),
        ["column 'motor_velocity'", "57.3 times the position's derivative", "[deg/s]"],
    ),
    "position in degrees": (
        changed(motor_velocity=times(1.0 / DEGREES)),
        ["motor_velocity is 0.0175 times", "position in degrees"],
    ),
    "velocity in rpm": (changed(link_velocity=times(30.0 / np.pi)), ["9.55 times", "[rpm]"]),
    "velocity backwards": (changed(link_velocity=times(-1.0)), ["-1 times", "scale it by -1"]),
    "jump": (
        positions_only(changed(motor_position=lambda q: q + 4.0 * (np.arange(len(q)) > 300))),
        ["column 'motor_position'", "jumps by", "at 1.505 s", "no whole turn", "outlier"],
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name: str, tmp_path: Path) -> None:
    """Assert that the message names the column, what is wrong and the remedy."""
    columns, words = REFUSED[name]
    with pytest.raises(RecordingError) as caught:
        read_log(write_csv(tmp_path, columns))
    for word in words:
        assert word in str(caught.value)


def freeze(values: FloatArray) -> FloatArray:
    """Hold a channel for half a second."""
    values[300:400] = values[300]
    return values


WARNED: dict[str, tuple[Columns, list[str]]] = {
    "clipped position": (
        positions_only(changed(motor_position=lambda q: np.clip(q, -0.5, 0.5))),
        ["column 'motor_position'", "extreme of -0.5 rad", "%", "clipped", "widen"],
    ),
    "clipped torque": (
        changed(motor_torque=lambda u: np.clip(u, -9.0, 15.0)),
        ["column 'motor_torque'", "clipped"],
    ),
    "frozen motor": (
        positions_only(changed(motor_position=freeze)),
        ["column 'motor_position'", "does not change from 1.5 s to 1.995 s", "check the sensor"],
    ),
    "frozen link": (
        positions_only(changed(link_position=freeze)),
        ["column 'link_position'", "does not change from 1.5 s to 1.995 s"],
    ),
    "small gear": (
        positions_only(changed(motor_position=times(6.0))),
        ["motor position moves 6 times as much", "check the gear ratio"],
    ),
    "strangers": (
        positions_only(changed(link_position=lambda q: np.sin(7.7 * 0.005 * np.arange(len(q))))),
        ["hardly follow each other", "correlation", "one joint"],
    ),
    "slightly wrong velocity": (
        changed(motor_velocity=times(1.08)),
        ["column 'motor_velocity'", "by 8 % RMS, as if it were scaled by 1.08", "leave it out"],
    ),
}


@pytest.mark.parametrize("name", WARNED)
def test_warned(name: str, tmp_path: Path) -> None:
    """Assert that the log is read, with a warning that names the column and the remedy."""
    columns, words = WARNED[name]
    log = read_log(write_csv(tmp_path, columns))
    assert all(warning.startswith(f"{log.source}: ") for warning in log.warnings)
    assert any(all(word in warning for word in words) for warning in log.warnings), log.warnings


def wrapped(folder: Path, low: float, unit: str = "rad") -> Log:
    """Read a slow motion over several turns from an encoder that wraps at `low` and a turn on."""
    time = 0.005 * np.arange(800)
    motor = 8.0 * np.sin(1.5 * time)
    turn = 2.0 * np.pi
    columns = {
        "time": time,
        f"link_position [{unit}]": low + np.mod(motor + 0.1 * np.sin(4.0 * time) - low, turn),
        f"motor_position [{unit}]": low + np.mod(motor - low, turn),
        "motor_torque": np.cos(time),
    }
    if unit == "deg":
        columns = {
            name: np.degrees(values) if "deg" in name else values
            for name, values in columns.items()
        }
    return read_log(write_csv(folder, columns))


@pytest.mark.parametrize("unit", ["rad", "deg"])
@pytest.mark.parametrize("low", [-np.pi, -1e-9])
def test_wraps_are_undone(tmp_path: Path, low: float, unit: str) -> None:
    """Assert that an absolute encoder's turns are counted, with a warning for each encoder."""
    log = wrapped(tmp_path, low, unit)
    (recording,) = log.recordings
    np.testing.assert_allclose(
        recording.motor_position, 8.0 * np.sin(1.5 * recording.time), atol=1e-8
    )
    np.testing.assert_allclose(recording.deflection, 0.1 * np.sin(4.0 * recording.time), atol=1e-8)
    assert len(log.warnings) == 2
    assert all("jumps by a turn at " in warning for warning in log.warnings)


def geared(folder: Path, encoder: FloatArray, entry: dict[str, object], **more: object) -> Log:
    """Read a slow motion, the motor's angle in turns of an encoder in front of the gear."""
    columns = {
        "time": SLOW,
        "link_position": MOTOR + 0.1 * np.sin(4.0 * SLOW),
        "encoder": encoder,
        "motor_torque": np.cos(SLOW),
    }
    return read_log(write_csv(folder, columns), {"motor_position": entry, **more})


SLOW = 0.002 * np.arange(2000)
MOTOR = 0.8 * np.sin(1.5 * SLOW)
TURNS = 200.0 * MOTOR / (2.0 * np.pi)
ENCODERS = {
    "a turn": (np.mod(TURNS, 1.0), {"column": "encoder", "unit": "turn"}),
    "a turn about zero": (np.mod(TURNS + 0.5, 1.0) - 0.5, {"column": "encoder", "unit": "turn"}),
    "a counter of four turns": (
        np.mod(np.round(1000.0 * TURNS), 4000.0),
        {"column": "encoder", "unit": "turn", "scale": "1/1000"},
    ),
    "a counter of 16 bits": (
        np.mod(np.round(4096.0 * TURNS) + 2**15, 2**16) - 2**15,
        {"column": "encoder", "unit": "turn", "scale": "1/4096"},
    ),
}


@pytest.mark.parametrize("name", ENCODERS)
def test_wraps_in_front_of_a_gear_are_undone(tmp_path: Path, name: str) -> None:
    """Assert that turns of the motor are counted, however many an encoder holds."""
    log = geared(tmp_path, *ENCODERS[name], gear_ratio=200)
    (recording,) = log.recordings
    np.testing.assert_allclose(recording.motor_position, MOTOR, atol=2e-5)
    assert any("jumps by a turn at " in warning for warning in log.warnings)


def test_a_fast_motor_does_not_wrap(tmp_path: Path) -> None:
    """Assert that a motor that makes more than half a turn between samples is taken as it is."""
    log = geared(tmp_path, 5.0 * TURNS, {"column": "encoder", "unit": "turn"}, gear_ratio=1000)
    np.testing.assert_allclose(log.recordings[0].motor_position, MOTOR, atol=1e-9)
    assert log.warnings == ()


def test_a_motor_too_fast_to_unwrap_is_refused(tmp_path: Path) -> None:
    """Assert that turns are not guessed where the motor makes up to half of one between samples."""
    encoder = np.mod(5.0 * TURNS, 1.0)
    with pytest.raises(RecordingError, match="if the encoder wraps, unwrap it, or log faster"):
        geared(tmp_path, encoder, {"column": "encoder", "unit": "turn"}, gear_ratio=1000)


def test_a_counter_of_unknown_turns_is_told_of(tmp_path: Path) -> None:
    """Assert that a position that jumps across its range is warned of where no gear is known."""
    encoder, entry = ENCODERS["a turn"]
    log = geared(tmp_path, encoder, {**entry, "scale": "1/200"})
    assert any("jumps by more than half of its range" in warning for warning in log.warnings)


@pytest.mark.parametrize("displaced", [0.6, 0.7, 0.8, 1.0])
def test_a_pause_is_no_wrap(tmp_path: Path, displaced: float) -> None:
    """Assert that a motor that moved during a pause, in front of a gear, is read as it is."""
    turns = 0.1 * np.sin(3.0 * SLOW)  # of the motor
    late = np.arange(len(SLOW)) >= len(SLOW) // 2
    turns[late] += displaced
    motor = 2.0 * np.pi * turns / 100.0
    columns = {
        "time": SLOW + late,
        "link_position": motor + 0.002 * np.sin(4.0 * SLOW),
        "encoder": turns,
        "motor_torque": np.cos(SLOW),
    }
    entry = {"column": "encoder", "unit": "turn"}
    log = read_log(write_csv(tmp_path, columns), {"motor_position": entry, "gear_ratio": 100})
    read = np.concatenate([recording.motor_position for recording in log.recordings])
    np.testing.assert_allclose(read, motor, atol=1e-9)


def test_an_encoder_of_one_count_is_no_jump(tmp_path: Path) -> None:
    """Assert that a position all of whose steps are as large as its range does not jump."""
    columns = {
        "time": SLOW,
        "link_position": 1e-3 * (np.arange(len(SLOW)) // 7 % 2),
        "motor_position": np.sin(SLOW),
        "motor_torque": 3.0 * np.cos(SLOW),
    }
    warnings = read_log(write_csv(tmp_path, columns)).warnings
    assert not any("jumps" in warning for warning in warnings)


def test_turns_that_an_encoder_does_not_know(tmp_path: Path) -> None:
    """Assert that encoders that begin on either side of zero do not differ by a turn."""
    motion = 4.0 * np.sin(1.5 * SLOW)
    columns = {
        "time": SLOW,
        "link_position": np.mod(motion + 0.02 * np.cos(4.0 * SLOW), 2.0 * np.pi),
        "motor_position": np.mod(motion - 0.01, 2.0 * np.pi),
        "motor_torque": np.cos(SLOW),
    }
    (recording,) = read_log(write_csv(tmp_path, columns)).recordings
    np.testing.assert_allclose(recording.deflection, 0.01 + 0.02 * np.cos(4.0 * SLOW), atol=1e-9)


def test_fast_with_a_stated_unit(tmp_path: Path) -> None:
    """Assert that a fast joint is believed, with a warning, where the unit is stated."""
    time = 1e-4 * np.arange(4000)
    columns = {
        "time": time,
        "link_position [rad]": 20.0 * np.sin(10.0 * time),
        "motor_position [rad]": 20.0 * np.sin(10.0 * time) + 0.1 * np.sin(30.0 * time),
        "motor_torque": np.cos(10.0 * time),
    }
    log = read_log(write_csv(tmp_path, columns))
    assert len(log.warnings) == 2
    assert "faster than a joint does at the link side: check the unit" in log.warnings[0]


def test_offset_of_a_velocity_does_no_harm(tmp_path: Path) -> None:
    """Assert that a constant error of a velocity is not taken for a wrong scale."""
    log = read_log(write_csv(tmp_path, changed(motor_velocity=lambda v: v + 0.3)))
    assert log.warnings == ()


def test_noisy_quantised_log_is_clean(tmp_path: Path) -> None:
    """Assert that encoder steps and noisy velocities give no warning."""
    rng = np.random.default_rng(9)
    step = 2.0 * np.pi / 2**14
    columns = changed(
        link_position=lambda q: step * np.round(q / step),
        motor_position=lambda q: step * np.round(q / step),
        link_velocity=lambda v: v + 0.05 * rng.standard_normal(len(v)),
    )
    assert read_log(write_csv(tmp_path, columns)).warnings == ()


def test_switched_input_is_no_clipping(tmp_path: Path) -> None:
    """Assert that a two-level input gives no warning."""
    assert read_log(write_csv(tmp_path, changed(motor_torque=np.sign))).warnings == ()


def test_resonance_is_no_gear(tmp_path: Path) -> None:
    """Assert that a link that swings three times as far as the motor is accepted."""
    columns = positions_only(changed(link_position=times(3.0)))
    assert read_log(write_csv(tmp_path, columns)).warnings == ()
