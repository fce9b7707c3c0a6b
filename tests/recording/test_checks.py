"""Logs whose channels make no sense: what is refused, mended or warned of."""

from collections.abc import Callable

import numpy as np
import pytest
from joint_log import assert_words, joint_columns, read_columns, refused, without

from flexid.arrays import FloatArray
from flexid.recording import Log

Columns = dict[str, FloatArray]
DEGREES = 180.0 / np.pi
TURN = 2.0 * np.pi
SLOW: FloatArray = 0.002 * np.arange(2000.0)


def changed(*left_out: str, **channels: Callable[[FloatArray], FloatArray] | float) -> Columns:
    """The synthetic log with some channels changed, or scaled; 4 s of it."""
    columns = joint_columns(800)
    for name, change in channels.items():
        own = columns[name].copy()
        columns[name] = change(own) if callable(change) else change * own
    return without(columns, *left_out)


def joint(link: FloatArray, motor: FloatArray, time: FloatArray = SLOW) -> Columns:
    """A slow motion of both encoders."""
    torque = np.cos(SLOW)
    return {"time": time, "link_position": link, "motor_position": motor, "motor_torque": torque}


REFUSED: list[tuple[Columns, str]] = [
    (
        changed(motor_position=0.0),
        "column 'motor_position': .*constant.*encoder is stuck.*record it while it moves",
    ),
    (changed(motor_torque=0.0), "column 'motor_torque': .*nothing drives"),
    (changed(link_velocity=0.0), "link_velocity is constant.*leave"),
    (
        {**changed(), "link_position": changed()["motor_position"]},
        "'link_position' and 'motor_position': .*one and the same.*log the second encoder",
    ),
    (
        changed("velocity", link_position=3e3, motor_position=3e3),
        r"column 'link_position': .* rad/s, faster than a joint.*link_position \[deg\]",
    ),
    (
        changed("velocity", link_position=DEGREES),
        "link position is about 57.3 times the motor.*degrees.*unit in brackets",
    ),
    (
        changed("velocity", motor_position=DEGREES),
        "motor position is about 57.3 times the link",
    ),
    (
        changed("velocity", motor_position=100.0),
        "times the link position, as if by a gear: write the drive's gear_ratio in a column map",
    ),
    (changed("velocity", motor_position=-1.0), "opposite directions: scale one by -1"),
    (
        changed(motor_velocity=DEGREES),
        r"column 'motor_velocity': .*57.3 times the position's derivative.*\[deg/s\]",
    ),
    (changed(motor_velocity=1.0 / DEGREES), "motor_velocity is 0.0175 times.*in degrees"),
    (changed(link_velocity=30.0 / np.pi), r"9.55 times.*\[rpm\]"),
    (changed(link_velocity=-1.0), "-1 times.*scale it by -1"),
    (
        changed("velocity", motor_position=lambda q: q + 4.0 * (np.arange(len(q)) > 300)),
        "column 'motor_position': .*jumps by.* at 1.505 s.*not a whole turn.*outlier",
    ),
]


@pytest.mark.parametrize(("columns", "words"), REFUSED, ids=[words[:30] for _, words in REFUSED])
def test_refused(columns: Columns, words: str) -> None:
    """Assert that the message names the column, what is wrong and the remedy."""
    assert_words(words, refused(read_columns, columns))


WARNED: list[tuple[Columns, str]] = [
    (
        changed("velocity", motor_position=lambda q: np.clip(q, -0.5, 0.5)),
        "column 'motor_position': .*extreme of -0.5 rad.* %.*clipped.*widen",
    ),
    (changed(motor_torque=lambda u: np.clip(u, -9.0, 15.0)), "'motor_torque': .*clipped"),
    (
        changed("velocity", motor_position=6.0),
        "motor position moves 6 times as much.*check the gear ratio",
    ),
    (
        changed("velocity", link_position=lambda q: np.sin(7.7 * 0.005 * np.arange(len(q)))),
        "hardly follow each other .correlation.*one joint",
    ),
    ({**changed("torque"), "motor_voltage": 3e3 * np.sin(SLOW[:800])}, "more than 2000, the limit"),
    ({**changed("torque"), "motor_current": 600 * np.sin(SLOW[:800])}, "more than 500, the limit"),
    (
        changed(motor_torque=lambda u: np.round(1000.0 * u)),
        "'motor_torque': .*holds whole numbers only, up to .*N m",
    ),
    (changed(motor_torque=999.5), "gives .* W, more than 20000, the limit for a joint's drive"),
    (
        changed(link_position=lambda q: q[np.arange(800) // 4 * 4]),
        "'link_position': .*changes only every 4 samples.*at its rate",
    ),
]


@pytest.mark.parametrize(("columns", "words"), WARNED, ids=[words[:30] for _, words in WARNED])
def test_warned(columns: Columns, words: str) -> None:
    """Assert that the log is read, with a warning that names the column and the remedy."""
    assert_words(f"arrays: .*{words}", "; ".join(read_columns(columns).warnings))


def coarse(step: float) -> Callable[[FloatArray], FloatArray]:
    """What an encoder of some step reads."""
    return lambda q: step * np.round(q / step)


CLEAN: dict[str, Columns] = {
    "an offset of a velocity": changed(motor_velocity=lambda v: v + 0.3),
    "encoder steps and a noisy velocity": changed(
        link_position=coarse(TURN / 2**14),
        motor_position=coarse(TURN / 2**14),
        link_velocity=lambda v: v + 0.05 * np.random.default_rng(9).standard_normal(len(v)),
    ),
    "a switched input": changed(motor_torque=np.sign),
    "an input of few whole numbers": changed(motor_torque=lambda u: 100.0 * np.sign(u)),
    "few absurd values of a torque": changed(
        motor_torque=lambda u: u + 1e6 * (np.arange(len(u)) % 40 == 7)
    ),
    "a link at its resonance": changed("velocity", link_position=3.0),
}


@pytest.mark.parametrize("name", CLEAN)
def test_clean(name: str) -> None:
    """Assert that nothing is said where nothing is wrong."""
    assert read_columns(CLEAN[name]).warnings == ()


NO_JUMPS = joint(1e-3 * (np.arange(2000.0) // 7.0 % 2.0), np.sin(SLOW))


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        (changed(link_position=coarse(0.02), motor_position=coarse(0.02)), "changes only"),
        ({**NO_JUMPS, "motor_torque": 3.0 * np.cos(SLOW)}, "jumps"),
    ],
)
def test_a_coarse_encoder(columns: Columns, words: str) -> None:
    """Assert that its steps are no repeated samples, and those of one count no jumps."""
    assert words not in " ".join(read_columns(columns).warnings)


def test_fast_with_a_stated_unit() -> None:
    """Assert that a fast joint is believed, with a warning, where the unit is stated."""
    time = 1e-4 * np.arange(4000)
    fast = 20.0 * np.sin(10.0 * time)
    link = {"link_position [rad]": fast, "motor_position [rad]": fast + 0.1 * np.sin(30.0 * time)}
    warnings = read_columns({"time": time, **link, "motor_torque": np.cos(10.0 * time)}).warnings
    assert len(warnings) == 2
    assert "faster than a joint does at the link side: check the unit" in warnings[0]


@pytest.mark.parametrize("unit", ["rad", "deg"])
@pytest.mark.parametrize("low", [-np.pi, -1e-9])
def test_wraps_are_undone(low: float, unit: str) -> None:
    """Assert that an absolute encoder's turns are counted, with a warning for each encoder."""
    time = 0.005 * np.arange(800)
    motor = 8.0 * np.sin(1.5 * time)
    deflection = 0.1 * np.sin(4.0 * time)
    factor = DEGREES if unit == "deg" else 1.0
    log = read_columns(
        {
            "time": time,
            f"link_position [{unit}]": factor * (low + np.mod(motor + deflection - low, TURN)),
            f"motor_position [{unit}]": factor * (low + np.mod(motor - low, TURN)),
            "motor_torque": np.cos(time),
        }
    )
    (recording,) = log.recordings
    np.testing.assert_allclose(recording.motor_position, motor, atol=1e-8)
    np.testing.assert_allclose(recording.deflection, deflection, atol=1e-8)
    assert len(log.warnings) == 2
    assert all("jumps by a turn at " in warning for warning in log.warnings)


def geared(encoder: FloatArray, entry: dict[str, object], **more: object) -> Log:
    """A slow motion, the motor's angle in turns of an encoder in front of the gear."""
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
    """Assert that turns of the motor are counted, however many an encoder holds."""
    log = geared(*ENCODERS[name], gear_ratio=200)
    np.testing.assert_allclose(log.recordings[0].motor_position, MOTOR, atol=2e-5)
    assert any("jumps by a turn at " in warning for warning in log.warnings)


def test_a_fast_motor_does_not_wrap() -> None:
    """Assert that half a turn between samples is no wrap, and that no turns are guessed."""
    log = geared(5.0 * TURNS, IN_TURNS, gear_ratio=1000)
    np.testing.assert_allclose(log.recordings[0].motor_position, MOTOR, atol=1e-9)
    assert log.warnings == ()
    message = refused(lambda: geared(np.mod(5.0 * TURNS, 1.0), IN_TURNS, gear_ratio=1000))
    assert "if the encoder wraps, unwrap it, or log faster" in message


def test_a_counter_of_unknown_turns_is_named() -> None:
    """Assert that a position that jumps across its range is warned of where no gear is known."""
    encoder, entry = ENCODERS["a turn"]
    log = geared(encoder, {**entry, "scale": "1/200"})
    assert any("jumps by more than half of its range" in warning for warning in log.warnings)


@pytest.mark.parametrize("displaced", [0.6, 0.7, 0.8, 1.0])
def test_a_pause_is_no_wrap(displaced: float) -> None:
    """Assert that a motor that moved during a pause, in front of a gear, is read as it is."""
    late = (np.arange(len(SLOW)) >= len(SLOW) // 2).astype(np.float64)
    turns = 0.1 * np.sin(3.0 * SLOW) + displaced * late  # of the motor
    motor = TURN * turns / 100.0
    columns = joint(motor + 0.002 * np.sin(4.0 * SLOW), turns, SLOW + late)
    entry = {"column": "motor_position", "unit": "turn"}
    log = read_columns(columns, {"motor_position": entry, "gear_ratio": 100})
    read = np.concatenate([recording.motor_position for recording in log.recordings])
    np.testing.assert_allclose(read, motor, atol=1e-9)


def test_turns_that_an_encoder_does_not_know() -> None:
    """Assert that encoders that begin on either side of zero do not differ by a turn."""
    motion, bent = 4.0 * np.sin(1.5 * SLOW), 0.02 * np.cos(4.0 * SLOW)
    columns = joint(np.mod(motion + bent, TURN), np.mod(motion - 0.01, TURN))
    (recording,) = read_columns(columns).recordings
    np.testing.assert_allclose(recording.deflection, 0.01 + bent, atol=1e-9)
