"""Frozen sensors: repeated samples in motion are left out."""

from typing import Any

import numpy as np
import pytest
from joint_log import joint_columns, read_columns, said, without

from flexid.arrays import FloatArray

STEP = 0.005  # s
ENCODERS = ("link_position", "motor_position")
Columns = dict[str, FloatArray]


def columns(count: int = 400, noise: float = 1e-5) -> Columns:
    """Return a motion with noise in rad on both positions, and its torque."""
    rng = np.random.default_rng(3)
    found = without(joint_columns(count, STEP), "velocity")
    for name in ENCODERS:
        found[name] += noise * rng.standard_normal(count)
    return found


def repeated(found: Columns, start: int = 320, stop: int = 400) -> Columns:
    """Return the log with one sample repeated over a range."""
    for name, values in found.items():
        if name != "time":
            values[start:stop] = values[start]
    return found


def quantised(found: Columns, bits: int) -> Columns:
    """Return the log with encoders of this many bits; 0 changes nothing."""
    step = 2.0 * np.pi / 2**bits
    for name in ENCODERS if bits else ():
        found[name] = step * np.round(found[name] / step)
    return found


def braked(deceleration: float, bits: int = 0, jump: float = 0.0) -> Columns:
    """Return a joint that turns back and forth, brakes evenly from 1 s on, and rests."""
    found, place = columns(noise=0.0), 200
    after = np.maximum(found["time"] - 1.0, 0.0)
    for name in ENCODERS:
        values = found[name]
        speed = (values[place] - values[place - 1]) / STEP
        braking = np.minimum(after, abs(speed) / deceleration)
        stop = speed * braking - 0.5 * np.sign(speed) * deceleration * braking**2
        values[place:] = values[place] + stop[place:]
        values[340:] += jump
    found["motor_torque"][300:] = 0.0
    return quantised(found, bits)


def at_rest(found: Columns, part: slice, place: int, *names: str) -> Columns:
    """Return the log with some channels constant over a part."""
    for name in names:
        found[name][part] = found[name][place]
    return found


CASES: dict[str, Columns] = {
    "the beginning": at_rest(columns(), slice(100), 100, *ENCODERS, "motor_torque"),
    "a link to the end": at_rest(columns(), slice(290, None), 290, "link_position"),
    "19 samples of it": at_rest(columns(), slice(381, None), 381, "link_position"),
    "a link in the middle": at_rest(columns(), slice(100, 140), 100, "link_position"),
    "19 samples of that": at_rest(columns(), slice(100, 119), 100, "link_position"),
    "a rest that jumps": braked(50.0, jump=0.3),
    "braking": braked(50.0),
    **{
        f"{moving} goes on": {**repeated(columns()), moving: columns()[moving]}
        for moving in ("motor_torque", "link_position")  # a brake, a stop
    },
}


def test_what_is_left_out(golden: Any):
    """Assert that repeated samples are left out in motion only."""
    golden({name: said(read_columns, found) for name, found in CASES.items()})


@pytest.mark.parametrize("bits", [0, 11, 12, 13, 14])
@pytest.mark.parametrize("braking", [1, 2, 5])
def test_a_drive_from_point_to_point_rests(bits: int, braking: int):
    """Assert that a drive that stops abruptly, rests without torque, and moves on is read whole."""
    run = np.r_[np.full(60, 0.8), np.linspace(0.8, 0.0, braking), np.zeros(70)]
    speed = np.concatenate([run] * 4)
    torque = np.where(speed == 0.0, 0.0, speed + np.sin(np.arange(len(speed))))
    link = np.cumsum(speed) * STEP
    found = {"time": STEP * np.arange(len(speed)), "motor_torque": torque}
    found |= {"link_position": link, "motor_position": link + 0.01 * torque}
    (recording,) = read_columns(quantised(found, bits)).recordings
    # At the very end a rest and a frozen logger look the same.
    assert len(recording) >= len(speed) - 70 + 1
