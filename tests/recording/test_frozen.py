"""A logger that repeats its last sample: what it repeats is no motion, and is left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from joint_log import joint_columns, write_csv

from flexid.arrays import FloatArray
from flexid.recording import read_log

STEP = 0.005  # s
NOISE = 1e-5  # rad


def columns(count: int = 400, noise: float = NOISE) -> dict[str, FloatArray]:
    """A motion with noise on both positions, and its torque."""
    rng = np.random.default_rng(3)
    found = joint_columns(count, STEP)
    for name in ("link_position", "motor_position"):
        found[name] += noise * rng.standard_normal(count)
    return {n: v for n, v in found.items() if "velocity" not in n}


def repeated(found: dict[str, FloatArray], start: int, stop: int) -> dict[str, FloatArray]:
    """The same with one sample in place of those that follow it."""
    for name, values in found.items():
        if name != "time":
            values[start:stop] = values[start]
    return found


def test_a_frozen_end_is_left_out(tmp_path: Path):
    """Assert that the log ends with the sample that is repeated, and that one sentence says so."""
    log = read_log(write_csv(tmp_path, repeated(columns(), 320, 400)))
    (recording,) = log.recordings
    assert len(recording) == 321
    (warning,) = log.warnings
    assert "nothing changes from 1.6 s to 1.995 s" in warning
    assert "left out" in warning


def test_a_frozen_middle_is_a_gap(tmp_path: Path):
    """Assert that the log goes on where it moves again."""
    log = read_log(write_csv(tmp_path, repeated(columns(), 100, 140)))
    assert [len(recording) for recording in log.recordings] == [101, 260]
    assert log.recordings[1].start_time == pytest.approx(140 * STEP)


@pytest.mark.parametrize("moving", ["motor_torque", "link_position"])
def test_what_goes_on_is_not_frozen(moving: str, tmp_path: Path):
    """Assert that nothing is left out where an input or a position goes on: a brake, a stop."""
    frozen = {**repeated(columns(), 320, 400), moving: columns()[moving]}
    log = read_log(write_csv(tmp_path, frozen))
    assert len(log.recordings[0]) == 400
    assert not any("left out" in warning for warning in log.warnings)


@pytest.mark.parametrize("bits", [0, 11, 12, 13, 14])
@pytest.mark.parametrize("braking", [1, 2, 5])
def test_a_drive_from_point_to_point_rests(bits: int, braking: int, tmp_path: Path):
    """Assert that a drive that stops dead, holds without a torque, and goes on is read whole."""
    speed = np.concatenate(
        [np.r_[np.full(60, 0.8), np.linspace(0.8, 0.0, braking), np.zeros(70)]] * 4
    )
    torque = np.where(speed == 0.0, 0.0, speed + np.sin(np.arange(len(speed))))
    link = np.cumsum(speed) * STEP
    found = {
        "time": STEP * np.arange(len(speed)),
        "link_position": link,
        "motor_position": link + 0.01 * torque,
        "motor_torque": torque,
    }
    if bits:
        step = 2.0 * np.pi / 2**bits
        for name in ("link_position", "motor_position"):
            found[name] = step * np.round(found[name] / step)
    log = read_log(write_csv(tmp_path, found))
    whole = len(speed) - 70 + 1  # at the very end, a rest and a frozen logger are the same
    assert sum(map(len, log.recordings)) >= whole
    assert len(log.recordings) == 1


def test_one_encoder_is_enough(tmp_path: Path):
    """Assert that a log of the motor alone is cut as well."""
    found = repeated(columns(), 320, 400)
    del found["link_position"]
    assert len(read_log(write_csv(tmp_path, found)).recordings[0]) == 321


def test_one_side_in_motion_is_enough(tmp_path: Path):
    """Assert that the other may stand still already, at the end of its swing."""
    found = columns()
    found["link_position"][290:] = found["link_position"][290]
    assert len(read_log(write_csv(tmp_path, repeated(found, 320, 400))).recordings[0]) == 321


@pytest.mark.parametrize(("times", "left"), [(60.0, 321), (6.0, 400)])
def test_a_motion_in_noise_does_not_say(times: float, left: int, tmp_path: Path):
    """Assert that nothing is left out where the motion just before is no clear one."""
    motor = columns(noise=0.0)["motor_position"]
    found = columns(noise=abs(motor[320] - motor[315]) / times)
    assert len(read_log(write_csv(tmp_path, repeated(found, 320, 400))).recordings[0]) == left


@pytest.mark.parametrize(("samples", "left"), [(19, 400), (20, 381)])
def test_a_few_samples_are_no_stretch(samples: int, left: int, tmp_path: Path):
    """Assert that it takes twenty."""
    log = read_log(write_csv(tmp_path, repeated(columns(), 400 - samples, 400)))
    assert len(log.recordings[0]) == left


@pytest.mark.parametrize(("samples", "left"), [(38, 1950), (39, 1912)])
def test_a_small_part_is_no_stretch(samples: int, left: int, tmp_path: Path):
    """Assert that it takes 2 % of the log."""
    log = read_log(write_csv(tmp_path, repeated(columns(1950), 1950 - samples, 1950)))
    assert len(log.recordings[0]) == left


def braked(deceleration: float, noise: float = 0.0) -> dict[str, FloatArray]:
    """A joint that turns back and forth, brakes evenly from 1 s on, and rests."""
    found = columns(noise=noise)
    after = np.maximum(found["time"] - 1.0, 0.0)
    place = 200
    for name in ("link_position", "motor_position"):
        values = found[name]
        speed = (values[place] - values[place - 1]) / STEP
        while_braking = np.minimum(after, abs(speed) / deceleration)
        stop = speed * while_braking - 0.5 * np.sign(speed) * deceleration * while_braking**2
        values[place:] = values[place] + stop[place:]
    found["motor_torque"][300:] = 0.0
    return found


@pytest.mark.parametrize("deceleration", [10.0, 50.0, 100.0])
@pytest.mark.parametrize("bits", [0, 12, 16])
def test_a_joint_that_brakes_is_not_frozen(deceleration: float, bits: int, tmp_path: Path):
    """Assert that a rest is kept that was reached by braking, though no encoder trembles."""
    found = braked(deceleration)
    if bits:
        step = 2.0 * np.pi / 2**bits
        for name in ("link_position", "motor_position"):
            found[name] = step * np.round(found[name] / step)
    log = read_log(write_csv(tmp_path, found))
    assert [len(recording) for recording in log.recordings] == [400]


def test_a_jump_is_no_motion(tmp_path: Path):
    """Assert that a rest is kept that is another from one sample to the next."""
    found = braked(50.0)
    for name in ("link_position", "motor_position"):
        found[name][340:] += 0.3
    log = read_log(write_csv(tmp_path, found))
    assert [len(recording) for recording in log.recordings] == [400]


def test_a_rest_from_the_start_is_kept(tmp_path: Path):
    """Assert that a log that begins at rest is read whole."""
    found = columns()
    for name in ("link_position", "motor_position", "motor_torque"):
        found[name][:100] = found[name][100]
    assert len(read_log(write_csv(tmp_path, found)).recordings[0]) == 400
