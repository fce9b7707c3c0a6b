"""Signs that contradict the mechanics are reversed and exchanged sides named, and no others.

The motion follows from the link's, ``q``, a sum of sines. Without friction of the link, ``theta = q
+ J q'' / k`` and ``u = M theta'' + J q'' + f theta'``.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from joint_log import read_columns

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.identification.preparation.recordings import check_alike
from flexid.recording.recording import rank_of

J, M, K, F = 0.4, 0.3, 600.0, 0.5  # kg m², kg m², N m/rad, N m s/rad
ANTIRESONANCE, RESONANCE = (K / J) ** 0.5, (K / J + K / M) ** 0.5  # rad/s
SLOW = (2.0, 5.3, 9.1, 14.7)
BETWEEN = (1.15 * ANTIRESONANCE,)  # between antiresonance and resonance
BEYOND = (0.98 * RESONANCE, 1.1 * RESONANCE)
COUNT = 1e-6  # rad, resolution of both encoders
TIME: FloatArray = 1e-3 * np.arange(8000.0)


def driven(*frequencies: float, inertia: float = M) -> dict[str, FloatArray]:
    """Return a joint whose link swings at these frequencies (rad/s) with 1 rad/s each."""
    waves = [(w, np.exp(1j * (w * TIME + k)) / w) for k, w in enumerate(frequencies)]

    def summed(factor: Any) -> FloatArray:
        return np.sum([(factor(1j * w) * wave).imag for w, wave in waves], axis=0)

    link = summed(lambda s: s**0)
    motor = summed(lambda s: 1.0 + J * s**2 / K)
    torque = summed(lambda s: (inertia * s**2 + F * s) * (1.0 + J * s**2 / K) + J * s**2)
    link, motor = (COUNT * np.rint(values / COUNT) for values in (link, motor))
    return {"time": TIME, "link_position": link, "motor_position": motor, "motor_torque": torque}


def with_deflection(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the log with a deflection sensor in place of the link's encoder."""
    found = {name: values for name, values in columns.items() if name != "link_position"}
    return found | {"deflection": columns["link_position"] - columns["motor_position"]}


def with_one_encoder(columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the log without the link's encoder."""
    return {name: values for name, values in columns.items() if name != "link_position"}


def let_down() -> dict[str, FloatArray]:
    """Return a load lowered from a quarter of a turn, which returns its energy."""
    angle = 0.75 * (1.0 + np.cos(np.pi * TIME / TIME[-1])) + 0.02 * np.sin(9.0 * TIME)
    acceleration = np.gradient(np.gradient(angle, TIME), TIME)
    torque = J * acceleration + 5.0 * np.sin(angle)
    assert torque[:-1] @ np.diff(angle) < 0.0
    return {"time": TIME, "motor_position": angle, "motor_torque": torque}


def pushed() -> dict[str, FloatArray]:
    """Return a pushed link, whose spring moves a motor without friction under a small torque."""
    motor = np.array([np.sin(w * TIME + k) / w for k, w in enumerate(SLOW)])
    torque = 0.01 * np.sin(3.7 * TIME)
    link = (1.0 - M * np.square(SLOW) / K) @ motor - torque / K
    link, motor = (COUNT * np.rint(values / COUNT) for values in (link, motor.sum(axis=0)))
    return {"time": TIME, "link_position": link, "motor_position": motor, "motor_torque": torque}


RIGHT: Mapping[str, Mapping[str, FloatArray]] = {
    "two encoders": driven(*SLOW),
    "a deflection": with_deflection(driven(*SLOW)),
    "one encoder": with_one_encoder(driven(*SLOW)),
    "sides that move against each other": driven(*BEYOND),
    "sides that move as far against each other": driven(
        *(ANTIRESONANCE * 2.0**0.5 * np.linspace(0.95, 1.05, 5)), inertia=J
    ),
    "a deflection of such": with_deflection(driven(*BEYOND)),
    "a load that pulls against the torque": with_one_encoder(driven(*BETWEEN)),
    "a load that is let down": let_down(),
    "a link that is pushed": pushed(),
}


@pytest.mark.parametrize("case", RIGHT)
def test_what_is_right_is_not_turned(case: str) -> None:
    """Assert that right signs and sides cause no warning."""
    log = read_columns(RIGHT[case])
    assert not any("the other sign" in w or "exchange" in w for w in log.warnings)


def test_columns_of_the_other_side_are_named() -> None:
    """Assert the warning about a log that has the link's encoder as the motor's and vice versa."""
    other = {"link_position": "motor_position", "motor_position": "link_position"}
    log = read_columns({other.get(n, n): v for n, v in RIGHT["two encoders"].items()})
    assert any("exchange both columns" in warning for warning in log.warnings)


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
    right = driven(*SLOW)
    speed = np.gradient(right["link_position"], TIME)
    for sign in (1.0, -1.0):
        counted = {"link_position": -right["link_position"], "link_velocity": sign * speed}
        log = read_columns(right | counted)
        assert ("link_velocity" in log.turned) == (sign < 0.0)
        found = log.recordings[0].link_velocity
        assert found is not None
        np.testing.assert_allclose(found, speed, atol=1e-9)


def test_a_recording_that_rests_says_nothing() -> None:
    """Assert that only the recording that moves decides, even if it is the shorter one."""
    right = driven(*SLOW)
    time = np.concatenate((TIME, 20.0 + 1e-3 * np.arange(12000.0)))
    rest = {n: np.concatenate((v, np.full(12000, v[-1]))) for n, v in right.items()}
    log = read_columns(rest | {"time": time, "motor_torque": -rest["motor_torque"]})
    assert len(log.recordings) == 2
    assert log.turned == ("motor_torque",)


def test_an_encoder_that_wraps_begins_near_the_other_one() -> None:
    """Assert that whole turns are subtracted after the sign is corrected."""
    right = driven(0.3, *SLOW)
    link = right["link_position"] + 2.5
    wrapped = np.angle(np.exp(-1j * link))
    log = read_columns(
        right | {"link_position": wrapped, "motor_position": right["motor_position"] + 2.5}
    )
    assert "link_position" in log.turned
    assert np.abs(log.recordings[0].deflection).max() < 1.0


def test_logs_that_show_different_signs_are_refused() -> None:
    """Assert that a log with a reversed sign is not combined with one without."""
    turned = read_columns(driven(*SLOW) | {"motor_torque": -driven(*SLOW)["motor_torque"]})
    with pytest.raises(RecordingError, match="motor_torque: shows another sign"):
        check_alike([read_columns(driven(*SLOW)), turned])
    check_alike([turned, turned])
