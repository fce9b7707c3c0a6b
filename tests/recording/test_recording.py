"""Recordings, their derived velocities and estimated noise, against closed forms."""

import re
from dataclasses import replace
from math import pi, sqrt
from typing import Any

import numpy as np
import pytest
from joint_log import joint_columns, read_columns, refused, without
from scipy.signal import lfilter

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.estimators.samples import samples_of_recording
from flexid.recording import Log, Recording, position_noise, with_velocities
from flexid.recording.velocities import integral, is_noise, velocity, while_free, while_moving

MOTION = without(joint_columns(), "torque")


RAMP, TIME = np.arange(10.0), 0.01 * np.arange(300)
RECORDING = Recording(0.1, 5.0, RAMP, 2.0 * RAMP, -RAMP, "V", motor_velocity=RAMP + 1.0)
ALONE = Recording(0.01, 2.0, None, np.sin(TIME), np.cos(TIME), "N m", source="arm.csv")


def test_windows() -> None:
    """Assert that a window keeps clock and memory within the recording, and reprs of one line."""
    np.testing.assert_allclose(RECORDING.time, 5.0 + 0.1 * np.arange(10))
    np.testing.assert_array_equal(RECORDING.deflection, -np.arange(10.0))
    part = RECORDING.window(3, 7)
    np.testing.assert_allclose(part.time, RECORDING.time[3:7])
    assert np.shares_memory(part.motor_velocity, RECORDING.motor_velocity)
    assert (len(part), part.link_velocity, part.input_unit) == (4, None, "V")
    for start, stop in ((-1, 3), (3, 3), (4, 2), (0, 11)):
        message = refused(RECORDING.window, start, stop)
        assert "choose 0 <= start < stop <= 10" in message
    with pytest.raises(RecordingError, match=r"input: .*\(9,\).*motor's position"):
        replace(RECORDING, input=np.arange(9.0))
    assert re.search(r"10 samples every 0\.1 s.*input \(V\), motor_velocity>", repr(RECORDING))
    assert repr(Log((RECORDING, RECORDING), (), "a.csv", "")) == "<Log a.csv: 1 s, 1 s>"


def test_motion_alone() -> None:
    """Assert that without an input the motor's motion drives the link."""
    (recording,) = read_columns(MOTION).recordings
    assert with_velocities(recording).window(10, 20).input is None
    samples = samples_of_recording(recording, "link")
    assert recording.motor_velocity is not None
    np.testing.assert_array_equal(samples.inputs[:, 0], recording.motor_position)
    np.testing.assert_array_equal(samples.inputs[:, 1], recording.motor_velocity)
    np.testing.assert_array_equal(samples.positions[:, 0], recording.link_position)
    (derived,) = read_columns(without(MOTION, "motor_velocity")).recordings
    inner = slice(20, -20)
    np.testing.assert_allclose(
        samples_of_recording(derived, "link").inputs[inner, 1],
        recording.motor_velocity[inner],
        atol=0.05,
    )
    assert re.search("input: .*identify the link alone", refused(samples_of_recording, recording))


def test_motor_alone() -> None:
    """Assert samples of a rigid joint with a derived velocity, and a remedy for the link."""
    words = r"arm\.csv: link_position: .*log it, or identify the rigid joint"
    assert re.search(words, refused(lambda: ALONE.deflection))
    assert re.search(words, refused(samples_of_recording, ALONE))
    part = with_velocities(ALONE).window(100, 200)
    assert part.link_position is None
    assert part.link_velocity is None
    assert part.motor_velocity is not None
    np.testing.assert_allclose(part.motor_velocity, np.cos(part.time - 2.0), atol=1e-6)
    samples = samples_of_recording(ALONE, "rigid")
    assert samples.velocities is None
    np.testing.assert_array_equal(samples.positions, ALONE.motor_position[:, np.newaxis])
    velocities = samples_of_recording(with_velocities(ALONE), "rigid").velocities
    assert velocities is not None
    assert velocities.shape == (300, 1)


FREQUENCIES, SIZES = np.array([2.0, 5.3, 11.0]), np.array([1.0, 0.5, 1.0 / 3.0])  # rad/s, rad
PHASES = np.outer(1e-3 * np.arange(5000), FREQUENCIES) + FREQUENCIES
POSITION, DERIVATIVE = np.sin(PHASES) @ SIZES, np.cos(PHASES) @ (FREQUENCIES * SIZES)


def quantised(bits: int) -> FloatArray:
    """Return the position by an encoder of this many bits."""
    step = 2 * pi / 2**bits
    return step * np.round(POSITION / step)


@pytest.mark.parametrize("sigma", [1e-5, 1e-4, 1e-3])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_white_noise_is_estimated(sigma: float, seed: int) -> None:
    """Assert that noise is found within 10 %, and 15 % with outliers of 1000 times its size."""
    noisy = POSITION + sigma * np.random.default_rng(seed).standard_normal(5000)
    assert position_noise(noisy) == pytest.approx(sigma, rel=0.1)
    noisy[[700, 2100, 4000]] += 1e3 * sigma
    assert position_noise(noisy) == pytest.approx(sigma, rel=0.15)


def test_noise_is_estimated_without_bias() -> None:
    """Assert the mean of many estimates within 1 %; a median alone is 2 % too small."""
    draws = np.random.default_rng(5).standard_normal((200, 1500))
    assert np.mean([position_noise(drawn) for drawn in draws]) == pytest.approx(1.0, abs=0.01)


def test_steps_and_short_motions() -> None:
    """Assert a noise of LSB / sqrt(12) within 10 %, and that no smooth stretch counts as noise."""
    assert position_noise(quantised(14)) == pytest.approx(2 * pi / 2**14 / sqrt(12), rel=0.1)
    resting = np.zeros(2000)
    resting[1500:] = 0.01 * np.round(np.linspace(0.0, 30.0, 500))
    assert position_noise(resting) == pytest.approx(0.01 / sqrt(12), rel=0.1)
    noise = np.random.default_rng(1).standard_normal(300)
    for count in range(20, 300):
        assert not is_noise(POSITION[: 17 * count : 17])
        assert is_noise(noise[:count]) == (count >= 40)
    assert is_noise(np.zeros(100))  # a sensor without even noise


@pytest.mark.parametrize("samples", [2.5, 3.0, 4.0, 5.0])
@pytest.mark.parametrize("count", [60, 2000])
def test_a_resonance_of_few_samples_a_period_is_no_noise(samples: float, count: int) -> None:
    """Assert that an oscillator driven by noise, with a mean near zero, does not count as noise."""
    pole = 0.95 * np.exp(2j * pi / samples)
    driven = np.random.default_rng(2).standard_normal(count + 200)
    swinging = np.asarray(lfilter([1.0], [1.0, -2.0 * pole.real, abs(pole) ** 2], driven))[200:]
    assert not is_noise(swinging)


@pytest.mark.parametrize(("bits", "bound"), [(12, 4e-3), (14, 1.5e-3), (20, 5e-5), (52, 1e-9)])
def test_derivative_of_an_encoder(bits: int, bound: float) -> None:
    """Assert that the error due to an encoder's steps stays below a bound."""
    error = velocity(quantised(bits), 1e-3) - DERIVATIVE
    assert np.sqrt(np.mean(error**2)) < bound


@pytest.mark.parametrize("count", [3, 4, 5, 8, 13, 20, 40])
def test_short_positions(count: int) -> None:
    """Assert that a straight line of any length has its slope as velocity."""
    line = 3.0 * 0.01 * np.arange(count, dtype=np.float64)
    np.testing.assert_allclose(velocity(line, 0.01), 3.0, atol=1e-9)


REST = np.zeros(3000)


@pytest.mark.parametrize("sigma", [0.0, 1e-4])
@pytest.mark.parametrize(
    ("positions", "first", "last"),
    [
        ([POSITION], 0, 5000),
        ([np.concatenate((REST + POSITION[0], POSITION))], 2500, 8000),
        ([np.concatenate((POSITION, REST + POSITION[-1]))], 0, 5500),
        ([np.concatenate((REST[:300] + POSITION[0], POSITION))], 0, 5300),  # too short to matter
        ([np.concatenate((REST + POSITION[0], POSITION)), np.zeros(8000)], 2500, 8000),
        ([REST, REST], 0, 3000),
    ],
)
def test_rest_before_and_after_a_motion(
    positions: list[FloatArray], first: int, last: int, sigma: float
) -> None:
    """Assert that rest beyond a tenth of the motion is left out, with or without noise."""
    rng = np.random.default_rng(3)
    found = while_moving([each + sigma * rng.standard_normal(len(each)) for each in positions])
    assert abs(found.start - first) <= 20
    assert abs(found.stop - last) <= 20


def test_a_faint_motion_is_taken_whole() -> None:
    """Assert that the slow start of a motion is kept in strong noise."""
    slow = POSITION * np.linspace(0.0, 1.0, 5000) ** 3
    noise = np.random.default_rng(3).standard_normal(5000)
    assert while_moving([slow + 1e-3 * noise]).start > 100
    assert while_moving([slow + 0.03 * noise]) == slice(0, 5000)


def test_derivatives_and_integrals() -> None:
    """Assert that only missing velocities are derived, and second order of an integral."""
    recording = Recording(1e-3, 0.0, POSITION, POSITION, POSITION, "N m", motor_velocity=DERIVATIVE)
    complete = with_velocities(recording)
    assert complete.motor_velocity is DERIVATIVE
    assert complete.link_velocity is not None
    np.testing.assert_allclose(complete.link_velocity, DERIVATIVE, atol=1e-8)
    errors = []
    for count in (200, 400, 800):
        even = np.linspace(0.0, 6.0, count + 1)
        times = even + 0.1 * np.sin(even)
        found = integral(np.cos(3.0 * times), times)
        errors.append(np.abs(found - np.sin(3.0 * times) / 3.0).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert ratios == pytest.approx([4.0, 4.0], abs=0.1)


@pytest.mark.parametrize(
    ("held", "size", "seconds", "first"),
    [
        (True, 1.0, 1.0, 500),
        (True, 2.0, 1.0, 500),
        (True, 0.3, 1.0, 0),
        (True, 1.0, 0.2, 0),
        (False, 1.0, 1.0, 0),
    ],
)
def test_a_brake_holds_a_motor(held: bool, size: float, seconds: float, first: int) -> None:
    """Assert that a held motor is left out if the torque is large, lasts, and is no noise."""
    time = np.arange(5000) / 500.0
    rng = np.random.default_rng(2)
    is_early = time < seconds
    acts = np.sin(9.0 * time) if held else rng.standard_normal(5000)
    motor = np.where(is_early, 0.0, np.sin(2.0 * (time - seconds)))
    free = while_free(
        motor + 1e-5 * rng.standard_normal(5000), np.where(is_early, size, 1.0) * acts
    )
    assert free.start == pytest.approx(first, abs=5)
    assert free.stop == 5000


def step(time: np.ndarray) -> np.ndarray:
    """Return a torque that begins after 1 s."""
    return np.where(time < 1.0, 0.0, 5.0)


@pytest.mark.parametrize(("torque", "moves"), [(step, 1.01), (np.positive, 6.0), (step, 11.0)])
def test_a_motor_at_rest_is_not_held(torque: Any, moves: float) -> None:
    """Assert that all stays of a step, a ramp against friction, and a motor that never moves."""
    time = np.arange(5000) / 500.0
    rng = np.random.default_rng(2)
    motor = np.maximum(time - moves, 0.0) ** 2 + 1e-5 * rng.standard_normal(5000)
    acts = torque(time) + 0.01 * rng.standard_normal(5000)
    assert while_free(motor, acts) == slice(0, 5000)
