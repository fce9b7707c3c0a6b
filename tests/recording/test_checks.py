"""Logs with implausible channels, signs or sides: refused, corrected or read with a warning."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest
from joint_log import joint_columns, read_columns, refused, said, without

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.identification.preparation.recordings import check_alike
from flexid.recording import Log
from flexid.recording.recording import rank_of

Columns = dict[str, FloatArray]
DEGREES = 180.0 / np.pi
TURN = 2.0 * np.pi
SLOW: FloatArray = 0.002 * np.arange(2000.0)


def changed(*left_out: str, **channels: Callable[[FloatArray], FloatArray] | float) -> Columns:
    """Return 4 s of the synthetic log with some channels changed, or scaled."""
    columns = joint_columns(800)
    for name, change in channels.items():
        own = columns[name].copy()
        columns[name] = change(own) if callable(change) else change * own
    return without(columns, *left_out)


def joint(link: FloatArray, motor: FloatArray, time: FloatArray = SLOW) -> Columns:
    """Return a slow motion of both encoders."""
    torque = np.cos(SLOW)
    return {"time": time, "link_position": link, "motor_position": motor, "motor_torque": torque}


def coarse(step: float) -> Callable[[FloatArray], FloatArray]:
    """Return a function that rounds to an encoder's step."""
    return lambda q: step * np.round(q / step)


def stated(scale: float) -> Columns:
    """Return a fast motion with a declared unit."""
    time: FloatArray = 1e-4 * np.arange(4000.0)
    motor = scale * np.sin(10.0 * time)
    link = motor + 0.1 * np.sin(30.0 * time)
    torque = {"motor_torque": np.cos(10.0 * time)}
    return {"time": time, "link_position [rad]": link, "motor_position [rad]": motor, **torque}


COUNTS = np.arange(800.0)
COARSE = coarse(TURN / 2**14)
NO_JUMPS = joint(1e-3 * (np.arange(2000.0) // 7.0 % 2.0), np.sin(SLOW))
SWING = np.sin(SLOW[:800])
CASES: dict[str, Columns] = {
    "a dead encoder": changed(motor_position=0.0),
    "a dead torque": changed(motor_torque=0.0),
    "a dead torque of a rigid joint": changed("link_position", "link_velocity", motor_torque=0.0),
    "a dead velocity": changed(link_velocity=0.0),
    "one encoder twice": {**changed(), "link_position": changed()["motor_position"]},
    "a fast joint": changed("velocity", link_position=3e3, motor_position=3e3),
    "a link in degrees": changed("velocity", link_position=DEGREES),
    "a motor in degrees": changed("velocity", motor_position=DEGREES),
    "a gear": changed("velocity", motor_position=100.0),
    "a sign": changed("velocity", motor_position=-1.0),
    "a velocity in degrees": changed(motor_velocity=DEGREES),
    "a position in degrees": changed(motor_velocity=1.0 / DEGREES),
    "a velocity in rpm": changed(link_velocity=30.0 / np.pi),
    "a velocity of the other sign": changed(link_velocity=-1.0),
    "a jump": changed("velocity", motor_position=lambda q: q + 4.0 * (COUNTS > 300)),
    "a clipped position": changed("velocity", motor_position=lambda q: np.clip(q, -0.5, 0.5)),
    "a clipped torque": changed(motor_torque=lambda u: np.clip(u, -9.0, 15.0)),
    "six times as much": changed("velocity", motor_position=6.0),
    "1.6 times as much": changed("velocity", motor_position=1.6),
    "1.4 times as much": changed("velocity", motor_position=1.4),
    "another motion": changed("velocity", link_position=lambda _: np.sin(0.0385 * COUNTS)),
    "a high voltage": {**changed("torque"), "motor_voltage": 3e3 * SWING},
    "a high current": {**changed("torque"), "motor_current": 600.0 * SWING},
    "whole numbers": changed(motor_torque=lambda u: np.round(1000.0 * u)),
    "a high power": changed(motor_torque=999.5),
    "a slow sensor": changed(link_position=lambda q: q[np.arange(800) // 4 * 4]),
    "a fast joint with a unit": stated(20.0),
    "a joint that is not too fast": stated(9.0),
    "an offset of a velocity": changed(motor_velocity=lambda v: v + 0.3),
    "encoder steps and a noisy velocity": changed(
        link_position=COARSE,
        motor_position=COARSE,
        link_velocity=lambda v: v + 0.05 * np.random.default_rng(9).standard_normal(800),
    ),
    "a switched input": changed(motor_torque=np.sign),
    "an input of few whole numbers": changed(motor_torque=lambda u: 100.0 * np.sign(u)),
    "few absurd values of a torque": changed(motor_torque=lambda u: u + 1e6 * (COUNTS % 40 == 7)),
    "three times as much": changed("velocity", link_position=3.0),
    "a coarse encoder": changed(link_position=coarse(0.02), motor_position=coarse(0.02)),
    "an encoder of two counts": {**NO_JUMPS, "motor_torque": 3.0 * np.cos(SLOW)},
    "an encoder of two counts in small motion": {
        **NO_JUMPS,
        "motor_position": 0.009 * np.sin(SLOW),
    },
}


def test_channels_that_make_no_sense(golden: Any) -> None:
    """Assert that faults are refused or named with a remedy, and that plausible logs are read."""
    golden({name: said(read_columns, columns) for name, columns in CASES.items()})


@pytest.mark.parametrize("low", [-np.pi, -1e-9])
def test_wraps_are_undone(low: float) -> None:
    """Assert that jumps of an absolute encoder by a turn are undone, with a warning for each."""
    time = 0.005 * np.arange(800)
    motor = 8.0 * np.sin(1.5 * time)
    deflection = 0.1 * np.sin(4.0 * time)
    wrapped = [low + np.mod(turned - low, TURN) for turned in (motor + deflection, motor)]
    positions = dict(zip(("link_position", "motor_position"), wrapped, strict=True))
    log = read_columns({"time": time, **positions, "motor_torque": np.cos(time)})
    (recording,) = log.recordings
    np.testing.assert_allclose(recording.motor_position, motor, atol=1e-8)
    np.testing.assert_allclose(recording.deflection, deflection, atol=1e-8)
    assert len(log.warnings) == 2
    assert all("jumps by a turn at " in warning for warning in log.warnings)


def geared(encoder: FloatArray, entry: dict[str, object], **more: object) -> Log:
    """Return a slow motion with the motor's angle from an encoder before the gear."""
    columns = {**joint(MOTOR + 0.1 * np.sin(4.0 * SLOW), MOTOR), "encoder": encoder}
    return read_columns(columns, {"motor_position": {"column": "encoder", **entry}, **more})


MOTOR = 0.8 * np.sin(1.5 * SLOW)
TURNS = 200.0 * MOTOR / TURN
IN_TURNS: dict[str, object] = {"unit": "turn"}
ENCODERS = {
    "a turn": (np.mod(TURNS, 1.0), IN_TURNS),
    "a turn about zero": (np.mod(TURNS + 0.5, 1.0) - 0.5, IN_TURNS),
    "a counter of four turns": (
        np.mod(np.round(1000.0 * TURNS), 4000.0),
        {"unit": "turn", "scale": "1/1000"},
    ),
    "a counter of 16 bits": (
        np.mod(np.round(4096.0 * TURNS) + 2**15, 2**16) - 2**15,
        {"unit": "turn", "scale": "1/4096"},
    ),
}


@pytest.mark.parametrize("name", ENCODERS)
def test_wraps_in_front_of_a_gear_are_undone(name: str) -> None:
    """Assert that wraps of the motor's encoder are undone, for any range of the encoder."""
    log = geared(*ENCODERS[name], gear_ratio=200)
    np.testing.assert_allclose(log.recordings[0].motor_position, MOTOR, atol=2e-5)
    assert any("jumps by a turn at " in warning for warning in log.warnings)


@pytest.mark.parametrize("displaced", [0.6, 0.7, 0.8, 1.0])
def test_a_pause_is_no_wrap(displaced: float) -> None:
    """Assert that a motor that moved during a pause, before a gear, is read unchanged."""
    late = (np.arange(len(SLOW)) >= len(SLOW) // 2).astype(np.float64)
    turns = 0.1 * np.sin(3.0 * SLOW) + displaced * late  # of the motor
    motor = TURN * turns / 100.0
    columns = joint(motor + 0.002 * np.sin(4.0 * SLOW), turns, SLOW + late)
    entry = {"column": "motor_position", "unit": "turn"}
    log = read_columns(columns, {"motor_position": entry, "gear_ratio": 100})
    read = np.concatenate([recording.motor_position for recording in log.recordings])
    np.testing.assert_allclose(read, motor, atol=1e-9)


def test_what_encoders_do_not_show() -> None:
    """Assert a warning without a gear ratio, the stated one of a held link, and equal turns."""
    encoder, entry = ENCODERS["a turn"]
    log = geared(encoder, {**entry, "scale": "1/200"})
    assert any("jumps by more than half of its range" in warning for warning in log.warnings)
    columns = changed("velocity", link_position=0.01)
    log = read_columns(columns, {"gear_ratio": 1})
    np.testing.assert_array_equal(log.recordings[0].motor_position, columns["motor_position"])
    assert "as if by a gear" in refused(read_columns, columns)
    motion, bent = 4.0 * np.sin(1.5 * SLOW), 0.02 * np.cos(4.0 * SLOW)
    columns = joint(np.mod(motion + bent, TURN), np.mod(motion - 0.01, TURN))
    (recording,) = read_columns(columns).recordings
    np.testing.assert_allclose(recording.deflection, 0.01 + bent, atol=1e-9)


# The motion follows from the link's, q, a sum of sines. Without friction of the link,
# theta = q + J q'' / k and u = M theta'' + J q'' + f theta'.
J, M, K, F = 0.4, 0.3, 600.0, 0.5  # kg m², kg m², N m/rad, N m s/rad
ANTIRESONANCE, RESONANCE = (K / J) ** 0.5, (K / J + K / M) ** 0.5  # rad/s
LOW = (2.0, 5.3, 9.1, 14.7)
BETWEEN = (1.15 * ANTIRESONANCE,)  # between antiresonance and resonance
BEYOND = (0.98 * RESONANCE, 1.1 * RESONANCE)
RESOLUTION = 1e-6  # rad, resolution of both encoders
CLOCK: FloatArray = 1e-3 * np.arange(8000.0)


def driven(*frequencies: float, inertia: float = M) -> dict[str, FloatArray]:
    """Return a joint whose link swings at these frequencies (rad/s) with 1 rad/s each."""
    waves = [(w, np.exp(1j * (w * CLOCK + k)) / w) for k, w in enumerate(frequencies)]

    def summed(factor: Any) -> FloatArray:
        return np.sum([(factor(1j * w) * wave).imag for w, wave in waves], axis=0)

    link = summed(lambda s: s**0)
    motor = summed(lambda s: 1.0 + J * s**2 / K)
    torque = summed(lambda s: (inertia * s**2 + F * s) * (1.0 + J * s**2 / K) + J * s**2)
    link, motor = (RESOLUTION * np.rint(values / RESOLUTION) for values in (link, motor))
    return {"time": CLOCK, "link_position": link, "motor_position": motor, "motor_torque": torque}


def with_deflection(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the log with a deflection sensor in place of the link's encoder."""
    deflection = columns["link_position"] - columns["motor_position"]
    return without(columns, "link") | {"deflection": deflection}


def let_down() -> dict[str, FloatArray]:
    """Return a load lowered from a quarter of a turn, which returns its energy."""
    angle = 0.75 * (1.0 + np.cos(np.pi * CLOCK / CLOCK[-1])) + 0.02 * np.sin(9.0 * CLOCK)
    acceleration = np.gradient(np.gradient(angle, CLOCK), CLOCK)
    torque = J * acceleration + 5.0 * np.sin(angle)
    assert torque[:-1] @ np.diff(angle) < 0.0
    return {"time": CLOCK, "motor_position": angle, "motor_torque": torque}


def pushed(gain: float = 0.0) -> dict[str, FloatArray]:
    """Return a pushed link, whose spring moves a motor without friction under a small torque.

    A controller with a `gain` adds that multiple of the spring's torque.
    """
    motor = np.array([np.sin(w * CLOCK + k) / w for k, w in enumerate(LOW)])
    disturbance = 0.01 * np.sin(3.7 * CLOCK)
    moved = motor.sum(axis=0)
    spring = (-M * np.square(LOW) @ motor - disturbance) / (1.0 + gain)
    sides = {"link_position": moved + spring / K, "motor_position": moved}
    rounded = {name: RESOLUTION * np.rint(side / RESOLUTION) for name, side in sides.items()}
    return {"time": CLOCK, **rounded, "motor_torque": disturbance + gain * spring}


def held() -> dict[str, FloatArray]:
    """Return a link that is pushed four times, with a motor that a controller and friction hold."""
    step = 2e-4
    times = step * np.arange(100_000.0)
    pushes = ((5.0, 4.0, 0.25), (-6.0, 9.0, 0.3), (4.0, 14.0, 0.2), (-5.0, 17.0, 0.3))
    push = np.sum([size * np.exp(-(((times - t) / w) ** 2)) for size, t, w in pushes], axis=0)
    link, motor, link_speed, motor_speed, torque = states = np.zeros((5, len(times)))
    for i in range(len(times) - 1):
        torque[i] = -30.0 * motor[i] - motor_speed[i]
        spring = 200.0 * (link[i] - motor[i])
        link_speed[i + 1] = link_speed[i] + step / 0.12 * (push[i] - spring - 0.05 * link_speed[i])
        free = motor_speed[i] + step / 0.08 * (torque[i] + spring - 0.5 * motor_speed[i])
        motor_speed[i + 1] = np.copysign(max(abs(free) - step / 0.08 * 0.3, 0.0), free)
        link[i + 1] = link[i] + step * link_speed[i + 1]
        motor[i + 1] = motor[i] + step * motor_speed[i + 1]
    sides = dict(
        zip(("link_position", "motor_position"), 1e-5 * np.rint(1e5 * states), strict=False)
    )
    every = {"time": times, "motor_torque": torque, **sides}
    return {name: own[:-1:5] for name, own in every.items()}


RIGHT: Mapping[str, Mapping[str, FloatArray]] = {
    "two encoders": driven(*LOW),
    "a deflection": with_deflection(driven(*LOW)),
    "one encoder": without(driven(*LOW), "link"),
    "sides that move against each other": driven(*BEYOND),
    "sides that move as far against each other": driven(
        *(ANTIRESONANCE * 2.0**0.5 * np.linspace(0.95, 1.05, 5)), inertia=J
    ),
    "a deflection of such": with_deflection(driven(*BEYOND)),
    "a load that pulls against the torque": without(driven(*BETWEEN), "link"),
    "a load that is let down": let_down(),
    "a link that is pushed": pushed(),
    "a link that is pushed, with a motor that helps": pushed(gain=1.0),
    "a link that is pushed, with a motor that is held": held(),
}


@pytest.mark.parametrize("case", RIGHT)
def test_what_is_right_is_not_turned(case: str) -> None:
    """Assert that right signs and sides cause no warning."""
    log = read_columns(RIGHT[case])
    assert not any("the other sign" in w or "exchange" in w for w in log.warnings)


@pytest.mark.parametrize(
    ("case", "counted", "told"),
    [
        ("two encoders", ("link_position",), ("link_position",)),
        ("two encoders", ("motor_torque",), ("motor_torque",)),
        ("two encoders", ("link_position", "motor_torque"), ("link_position", "motor_torque")),
        ("a deflection", ("deflection",), ("deflection",)),
        ("a deflection", ("deflection", "motor_torque"), ("deflection", "motor_torque")),
        ("one encoder", ("motor_torque",), ("motor_torque",)),
        ("a deflection of such", ("deflection",), ("deflection",)),
    ],
)
def test_a_wrong_sign_is_turned(case: str, counted: tuple[str, ...], told: tuple[str, ...]) -> None:
    """Assert that a channel with the wrong sign is reversed, with a warning."""
    right = read_columns(RIGHT[case])
    turned = read_columns({n: -v if n in counted else v for n, v in RIGHT[case].items()})
    for one, own in zip(turned.recordings, right.recordings, strict=True):
        np.testing.assert_array_equal(one.motor_position, own.motor_position)
        np.testing.assert_array_equal(one.input, own.input)
        if one.link_position is not None and own.link_position is not None:
            np.testing.assert_allclose(one.link_position, own.link_position, atol=1e-12)
    said = [warning for warning in turned.warnings if "the other sign" in warning]
    assert len(said) == len(told)
    for name, warning in zip(told, said, strict=True):
        assert f"{name} was taken with the other sign" in warning
        assert "scale = -1" in warning
        assert rank_of(warning).name == "SCALE"
        assert turned.columns[name].factor == -right.columns[name].factor


def test_a_reversed_link_takes_its_velocity_along_if_that_is_reversed() -> None:
    """Assert that a velocity gets the sign of its position's derivative."""
    right = driven(*LOW)
    speed = np.gradient(right["link_position"], CLOCK)
    for sign in (1.0, -1.0):
        counted = {"link_position": -right["link_position"], "link_velocity": sign * speed}
        log = read_columns(right | counted)
        assert ("link_velocity" in log.turned) == (sign < 0.0)
        found = log.recordings[0].link_velocity
        assert found is not None
        np.testing.assert_allclose(found, speed, atol=1e-9)


def test_signs_with_rest_and_wraps() -> None:
    """Assert that the moving recording decides, and that turns are subtracted after the sign."""
    right = driven(*LOW)
    time = np.concatenate((CLOCK, 20.0 + 1e-3 * np.arange(12000.0)))
    rest = {n: np.concatenate((v, np.full(12000, v[-1]))) for n, v in right.items()}
    log = read_columns(rest | {"time": time, "motor_torque": -rest["motor_torque"]})
    assert len(log.recordings) == 2
    assert log.turned == ("motor_torque",)
    right = driven(0.3, *LOW)
    link = right["link_position"] + 2.5
    wrapped = np.angle(np.exp(-1j * link))
    log = read_columns(
        right | {"link_position": wrapped, "motor_position": right["motor_position"] + 2.5}
    )
    assert "link_position" in log.turned
    assert np.abs(log.recordings[0].deflection).max() < 1.0


def test_a_deflection_may_rest() -> None:
    """Assert that a deflection that rests while the motor turns steadily is no dead sensor."""
    motor = SLOW + 0.1 * np.sin(SLOW)
    bent = COARSE(0.01 * np.sin(SLOW))
    bent[-300:] = bent[-301]
    columns = {"time": SLOW, "motor_position": motor, "deflection": bent}
    log = read_columns(columns | {"motor_torque": np.cos(SLOW)})
    assert not any("stuck" in warning for warning in log.warnings)


def test_exchanged_sides_and_different_signs() -> None:
    """Assert a warning of exchanged encoders, and that logs of different signs do not combine."""
    other = {"link_position": "motor_position", "motor_position": "link_position"}
    log = read_columns({other.get(n, n): v for n, v in RIGHT["two encoders"].items()})
    assert any("exchange both columns" in warning for warning in log.warnings)
    turned = read_columns(driven(*LOW) | {"motor_torque": -driven(*LOW)["motor_torque"]})
    with pytest.raises(RecordingError, match="motor_torque: shows another sign"):
        check_alike([read_columns(driven(*LOW)), turned])
    check_alike([turned, turned])
