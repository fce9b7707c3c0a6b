"""A logger that repeats its last sample: what it repeats is no motion, and is left out."""

import numpy as np
import pytest
from joint_log import joint_columns, read_columns, without

from flexid.arrays import FloatArray

STEP = 0.005  # s
ENCODERS = ("link_position", "motor_position")
Columns = dict[str, FloatArray]


def columns(count: int = 400, noise: float = 1e-5) -> Columns:
    """A motion with noise in rad on both positions, and its torque."""
    rng = np.random.default_rng(3)
    found = without(joint_columns(count, STEP), "velocity")
    for name in ENCODERS:
        found[name] += noise * rng.standard_normal(count)
    return found


def repeated(found: Columns, start: int, stop: int) -> Columns:
    """The same with one sample in place of those that follow it."""
    for name, values in found.items():
        if name != "time":
            values[start:stop] = values[start]
    return found


def quantised(found: Columns, bits: int) -> Columns:
    """The same by encoders of so many bits; of none, as it is."""
    step = 2.0 * np.pi / 2**bits
    for name in ENCODERS if bits else ():
        found[name] = step * np.round(found[name] / step)
    return found


def lengths(found: Columns) -> list[int]:
    """How many samples the recordings have."""
    return [len(recording) for recording in read_columns(found).recordings]


def test_a_frozen_end_is_left_out():
    """Assert that the log ends with the sample that is repeated, and that one sentence says so."""
    log = read_columns(repeated(columns(), 320, 400))
    assert len(log.recordings[0]) == 321
    (warning,) = log.warnings
    assert "nothing changes from 1.6 s to 1.995 s" in warning
    assert "left out" in warning


def test_a_frozen_middle_is_a_gap():
    """Assert that the log goes on where it moves again."""
    log = read_columns(repeated(columns(), 100, 140))
    assert [len(recording) for recording in log.recordings] == [101, 260]
    assert log.recordings[1].start_time == pytest.approx(140 * STEP)


@pytest.mark.parametrize("moving", ["motor_torque", "link_position"])
def test_what_goes_on_is_not_frozen(moving: str):
    """Assert that nothing is left out where an input or a position goes on: a brake, a stop."""
    log = read_columns({**repeated(columns(), 320, 400), moving: columns()[moving]})
    assert len(log.recordings[0]) == 400
    assert not any("left out" in warning for warning in log.warnings)


@pytest.mark.parametrize("bits", [0, 11, 12, 13, 14])
@pytest.mark.parametrize("braking", [1, 2, 5])
def test_a_drive_from_point_to_point_rests(bits: int, braking: int):
    """Assert that a drive that stops dead, holds without a torque, and goes on is read whole."""
    run = np.r_[np.full(60, 0.8), np.linspace(0.8, 0.0, braking), np.zeros(70)]
    speed = np.concatenate([run] * 4)
    torque = np.where(speed == 0.0, 0.0, speed + np.sin(np.arange(len(speed))))
    link = np.cumsum(speed) * STEP
    found = {"time": STEP * np.arange(len(speed)), "motor_torque": torque}
    found |= {"link_position": link, "motor_position": link + 0.01 * torque}
    (length,) = lengths(quantised(found, bits))
    assert length >= len(speed) - 70 + 1  # at the very end a rest and a frozen logger are the same


def test_one_side_in_motion_is_enough():
    """Assert that the other may stand still, at the end of its swing, or not be there at all."""
    assert lengths(without(repeated(columns(), 320, 400), "link")) == [321]
    found = columns()
    found["link_position"][290:] = found["link_position"][290]
    assert lengths(repeated(found, 320, 400)) == [321]


@pytest.mark.parametrize(("times", "left"), [(60.0, 321), (6.0, 400)])
def test_a_motion_in_noise_does_not_say(times: float, left: int):
    """Assert that nothing is left out where the motion just before is no clear one."""
    motor = columns(noise=0.0)["motor_position"]
    found = columns(noise=abs(motor[320] - motor[315]) / times)
    assert lengths(repeated(found, 320, 400)) == [left]


@pytest.mark.parametrize(
    ("samples", "count", "left"),
    [(19, 400, 400), (20, 400, 381), (38, 1950, 1950), (39, 1950, 1912)],
)
def test_a_few_samples_are_no_stretch(samples: int, count: int, left: int):
    """Assert that it takes twenty, and 2 % of the log."""
    assert lengths(repeated(columns(count), count - samples, count)) == [left]


def braked(deceleration: float) -> Columns:
    """A joint that turns back and forth, brakes evenly from 1 s on, and rests."""
    found, place = columns(noise=0.0), 200
    after = np.maximum(found["time"] - 1.0, 0.0)
    for name in ENCODERS:
        values = found[name]
        speed = (values[place] - values[place - 1]) / STEP
        braking = np.minimum(after, abs(speed) / deceleration)
        stop = speed * braking - 0.5 * np.sign(speed) * deceleration * braking**2
        values[place:] = values[place] + stop[place:]
    found["motor_torque"][300:] = 0.0
    return found


@pytest.mark.parametrize("deceleration", [10.0, 50.0, 100.0])
@pytest.mark.parametrize("bits", [0, 12, 16])
def test_a_joint_that_brakes_is_not_frozen(deceleration: float, bits: int):
    """Assert that a rest is kept that was reached by braking, though no encoder trembles."""
    assert lengths(quantised(braked(deceleration), bits)) == [400]


def test_a_jump_is_no_motion():
    """Assert that a rest is kept that is another from one sample to the next."""
    found = braked(50.0)
    for name in ENCODERS:
        found[name][340:] += 0.3
    assert lengths(found) == [400]


def test_a_rest_from_the_start_is_kept():
    """Assert that a log that begins at rest is read whole."""
    found = columns()
    for name in (*ENCODERS, "motor_torque"):
        found[name][:100] = found[name][100]
    assert lengths(found) == [400]
