"""Logs that are wrong in meaning, of a joint that is known: each fault is named, and alone."""

from collections.abc import Callable

import numpy as np
import pytest
from benchmarks.trials.integrator import Drive, Law, Smooth, simulate
from joint_log import assert_words, refused

from flexid.arrays import FloatArray
from flexid.identification.preparation.recordings import prepare
from flexid.library.logs import read_log
from flexid.recording import Log
from flexid.recording.caution import Rank, rank_of
from flexid.recording.slow_motion import late_input

STEP = 2e-3  # s
COUNT = 6000
NOISE = 1e-5  # rad
LINK, MOTOR, TORQUE = "link_position [rad]", "motor_position [rad]", "motor_torque [N m]"
LINK_SPEED, MOTOR_SPEED = "link_velocity [rad/s]", "motor_velocity [rad/s]"

Columns = dict[str, FloatArray]


def simulated(size: float = 1.0) -> Columns:
    """12 s of a joint with gravity, friction and white noise on its sensors."""
    rng = np.random.default_rng(1)
    tones = np.array([0.7, 3.3, 5.3, 8.1, 12.0, 17.0, 21.0])
    forces = size * np.array([2.5, 3.0, 4.0, 4.0, 4.0, 4.0, 4.0])
    phases = rng.uniform(0.0, 2.0 * np.pi, len(tones))

    def torque(at: FloatArray) -> FloatArray:
        return np.asarray(np.sin(np.outer(at, tones) + phases) @ forces, dtype=np.float64)

    time = STEP * np.arange(COUNT, dtype=np.float64)
    drive = Drive(1.0, 0.3, 100.0, gravity_torque=5.0, motor_viscous=0.2)
    smooth = Smooth(torque(-0.02 + 1e-4 * np.arange(120_600, dtype=np.float64)), -0.02, 1e-4)
    zeros = np.zeros((COUNT, 3))
    states, _ = simulate(
        drive, time, time, time, torque(time), zeros[:, 0], smooth, Law(), zeros, 0.0, 5e-4
    )
    return {
        "time [s]": time,
        LINK: states[:, 0] + NOISE * rng.standard_normal(COUNT),
        MOTOR: states[:, 2] + NOISE * rng.standard_normal(COUNT),
        TORQUE: torque(time),
        LINK_SPEED: states[:, 1] + 1e-3 * rng.standard_normal(COUNT),
        MOTOR_SPEED: states[:, 3] + 1e-3 * rng.standard_normal(COUNT),
    }


CLEAN = simulated()
POSITIONS = ("time [s]", LINK, MOTOR, TORQUE)
Change = Callable[[FloatArray], FloatArray]


def with_changes(**changes: Change) -> Columns:
    """The log without velocities, some of its channels changed."""
    columns = {name: CLEAN[name].copy() for name in POSITIONS}
    for name, change in changes.items():
        column = {"link": LINK, "motor": MOTOR, "torque": TORQUE}[name]
        columns[column] = change(columns[column])
    return columns


def changed(**changes: Change) -> Log:
    """The same, read."""
    return read_log(with_changes(**changes))


def times(factor: float) -> Change:
    """Scale a channel."""
    return lambda values: factor * values


def held(first: int, last: int) -> Change:
    """Repeat a sample."""
    return lambda values: np.r_[values[:first], np.full(last - first, values[first]), values[last:]]


def spiked(places: list[int], size: float) -> Change:
    """Displace single samples."""
    return lambda values: values + size * np.isin(np.arange(COUNT), places)


SMALL = simulated(0.1)
CONTROLLED = -30.0 * CLEAN[MOTOR] - 2.0 * CLEAN[MOTOR_SPEED]
SWAPPED = {LINK_SPEED: CLEAN[MOTOR_SPEED], MOTOR_SPEED: CLEAN[LINK_SPEED]}
DIFFERS = "differs from the derivative of its position by .*: it is not used"
SAID: dict[str, tuple[Columns, list[str]]] = {
    "a right log": (with_changes(), []),
    "one with velocities": (CLEAN, []),
    "a link that moves 0.5 % more": (
        with_changes(link=times(1.005)),
        ["the link moves 1.004.*gear ratio"],
    ),
    "0.2 %": (with_changes(link=times(1.002)), []),
    "a motor that moves 2 % more": (with_changes(motor=times(1.02)), ["the link moves 0.980"]),
    "2 % less": (with_changes(motor=times(1.0 / 1.02)), ["the link moves 1.02"]),
    # The angle is too much like its sine.
    "2 % of a small motion": (
        {name: SMALL[name] * (1.02 if name == MOTOR else 1.0) for name in POSITIONS},
        [],
    ),
    # In proportion to angle and velocity, it is no gravity in degrees.
    "a controller": (with_changes(torque=lambda _: CONTROLLED), []),
    "a spike in noise": (with_changes(link=spiked([900], 40.0 * NOISE)), ["1 sample is off"]),
    "what noise may have moved": (with_changes(link=spiked([900], 10.0 * NOISE)), []),
    # A side that rests to the end may have met a brake.
    "a sensor that dies": (
        with_changes(motor=held(5000, COUNT)),
        ["motor_position does not change from 10 s to 11.998 s"],
    ),
    "velocities of the other sides": (CLEAN | SWAPPED, [DIFFERS, DIFFERS]),
    "a velocity that is scaled": (
        CLEAN | {LINK_SPEED: 1.28 * CLEAN[LINK_SPEED]},
        ["28 % RMS: it is not used"],
    ),
    "a velocity that is late": (
        CLEAN | {MOTOR_SPEED: np.roll(CLEAN[MOTOR_SPEED], 10)},
        [DIFFERS],
    ),
    "a velocity that is 2 ms late": (
        CLEAN | {MOTOR_SPEED: np.roll(CLEAN[MOTOR_SPEED], 1)},
        [],
    ),
    "a velocity of noise": (
        CLEAN | {LINK_SPEED: np.random.default_rng(8).standard_normal(COUNT)},
        [DIFFERS],
    ),
}


@pytest.mark.parametrize("name", SAID)
def test_what_is_said(name: str):
    """Assert that each fault is named once, and that a velocity is used unless it is wrong."""
    columns, words = SAID[name]
    log = read_log(dict(columns))
    assert len(log.warnings) == len(words)
    for warning, pattern in zip(log.warnings, words, strict=True):
        assert_words(pattern, warning)
        is_data = "sample" in pattern or "change" in pattern
        assert rank_of(warning) == (Rank.DATA if is_data else Rank.SCALE)
    (recording,) = log.recordings
    assert len(recording) == COUNT
    for speed in {LINK_SPEED, MOTOR_SPEED} & {*columns}:
        channel = speed.partition(" ")[0]
        is_wrong = any(f"{channel} differs" in warning for warning in log.warnings)
        assert (getattr(recording, channel) is None) == is_wrong


@pytest.mark.parametrize(("samples", "said"), [(25, "-0.05"), (-51, "0.102"), (10, "")])
def test_an_input_that_is_far_off_in_time(samples: int, said: str):
    """Assert that a delay that no fit seeks is named to a sample, and one that is sought is not."""
    log = changed(torque=lambda values: np.roll(values, samples))
    assert log.warnings == ()
    found = [*late_input(log.recordings[0])]
    assert len(found) == bool(said)
    for warning in found:
        assert f"give --input-delay={said}" in warning
        assert rank_of(warning) == Rank.SCALE


def test_an_input_that_stands_still_is_not_late():
    """Assert that nothing is said where the input acts at the beginning alone."""
    log = changed(torque=lambda values: values * (np.arange(COUNT) < 50))
    assert [*late_input(log.recordings[0])] == []


def test_one_missing_sample_is_no_rounded_clock():
    """Assert that a log is cut where one sample is missing, and not stretched to close the gap."""
    log = read_log({name: np.delete(CLEAN[name], 3000) for name in POSITIONS})
    assert [len(recording) for recording in log.recordings] == [3000, COUNT - 3001]
    for recording in log.recordings:
        assert recording.sample_time == pytest.approx(STEP, 1e-9)


@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (np.pi / 180.0, "radians read as degrees"),
        (180.0 / np.pi, "degrees read as radians"),
        (0.5 / np.pi, "turns read as radians"),
    ],
)
def test_an_angle_in_another_unit(factor: float, said: str):
    """Assert that gravity shows the unit of the angles, and is asked for nothing else then."""
    found = [w for w in changed(link=times(factor), motor=times(factor)).warnings if "load" in w]
    assert len(found) == 1
    assert said in found[0]


@pytest.mark.parametrize(("every", "said"), [(33, True), (2500, False)])
def test_samples_that_are_lost(every: int, said: bool):
    """Assert that lost samples are found in positions alone, and that two are not worth a word."""
    kept = np.arange(COUNT) % every != every - 1
    columns = {name: CLEAN[name][kept] for name in POSITIONS}
    log = read_log(columns | {"time [s]": STEP * np.arange(kept.sum())})
    assert [("were lost" in w and "log the time" in w) for w in log.warnings] == [True] * said
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(STEP, rel=1e-9)
    assert len(log.uncounted) == len(recording) - kept.sum()
    if said:  # and are put back
        assert len(recording) > 0.99 * COUNT
        part = slice(0, COUNT // 3)
        np.testing.assert_allclose(
            recording.needed_link_position[part], CLEAN[LINK][part], atol=20 * NOISE
        )


@pytest.mark.parametrize(("every", "parts"), [(600, 1), (1200, 5)])
def test_losses_that_the_clock_shows(every: int, parts: int):
    """Assert that up to three in a place are put back where a cut leaves less than two seconds."""
    places = np.arange(1000, COUNT, every)
    gone = np.concatenate([places, places[::2] + 1, places[::2] + 2])
    kept = np.delete(np.arange(COUNT), gone)
    log = read_log({name: CLEAN[name][kept] for name in POSITIONS})
    assert len(log.recordings) == parts + (parts > 1)
    if parts == 1:
        (recording,) = log.recordings
        np.testing.assert_allclose(recording.time, CLEAN["time [s]"], atol=1e-9)
        np.testing.assert_allclose(recording.motor_position, CLEAN[MOTOR], atol=20 * NOISE)
        assert f"{len(gone)} samples are missing in {len(places)} places" in log.warnings[0]


def test_spikes_are_replaced():
    """Assert that single samples are named, and taken from their neighbours to 10 times noise."""
    log = changed(link=spiked([900, 2000, 3333], 0.05), motor=spiked([2500], 40.0))
    assert ["link_position" in w and "3 samples" in w for w in log.warnings] == [True, False]
    assert "1 sample is off the samples around by up to 40 rad (at 5 s)" in log.warnings[1]
    (recording,) = log.recordings
    np.testing.assert_allclose(recording.needed_link_position, CLEAN[LINK], atol=10 * NOISE)
    np.testing.assert_allclose(recording.motor_position, CLEAN[MOTOR], atol=10 * NOISE)


@pytest.mark.parametrize("power", [0, 1, 2])
@pytest.mark.parametrize("part", [0.0, 0.5])
def test_a_stop_is_no_spike(power: int, part: float):
    """Assert that a position, velocity or acceleration that jumps is not smoothed."""
    after = np.maximum(np.arange(COUNT) - 3000.0 - part, 0.0)
    jump = 0.01 * np.sign(after) * after**power
    log = changed(link=lambda q: q + jump, motor=lambda q: q + jump)
    assert not any("off the samples" in warning for warning in log.warnings)


@pytest.mark.parametrize("side", ["link", "motor"])
@pytest.mark.parametrize("first", [2000, 3200])
def test_a_sensor_that_is_stuck_for_a_while(side: str, first: int):
    """Assert that 0.3 s of 12 s are named and left out as a gap."""
    log = changed(**{side: held(first, first + 150)})
    assert [len(recording) for recording in log.recordings] == [first + 1, COUNT - first - 150]
    assert f"column '{side}_position [rad]'" in log.warnings[0]
    assert f"{side}_position does not change from {first * STEP:g} s" in log.warnings[0]
    assert "check the sensor" in log.warnings[0]
    assert rank_of(log.warnings[0]) == Rank.DATA


def test_a_link_that_sticks_is_no_fault():
    """Assert that a side that rests and goes on smoothly while the other one winds up is kept."""
    link = CLEAN[LINK].copy()
    rest = np.zeros(200)
    at = 3000
    stuck = np.concatenate((link[:at], link[at] + rest, link[at:-200]))
    motor = CLEAN[MOTOR] + 0.0
    motor[at : at + 200] = np.linspace(motor[at], motor[at] + 0.02, 200)
    columns = {"time [s]": CLEAN["time [s]"], LINK: stuck, MOTOR: motor, TORQUE: CLEAN[TORQUE]}
    columns[LINK][at + 200 :] = link[at] + 0.5 * (STEP * np.arange(COUNT - at - 200)) ** 2
    assert sum(map(len, read_log(columns).recordings)) == COUNT


def noise(_: FloatArray) -> FloatArray:
    """White noise about a constant."""
    return 0.3 + NOISE * np.random.default_rng(5).standard_normal(COUNT)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"motor": noise}, "motor_position is constant"),
        ({"link": noise}, "link_position is constant"),
        ({"torque": lambda _: CLEAN[MOTOR_SPEED]}, "same signal as the derivative of motor_posit"),
        ({"torque": lambda _: CLEAN[LINK]}, "same signal as link_position"),
    ],
)
def test_a_dead_or_copied_channel_is_refused(changes: dict[str, Change], words: str):
    """Assert that what can be identified from nothing is refused at once."""
    assert words in refused(lambda: changed(**changes))


def test_a_deflection_of_noise_alone_is_a_rigid_joint():
    """Assert that the spring is sought only where the encoders differ by more than noise."""
    copied = changed(link=lambda _: CLEAN[MOTOR] + noise(CLEAN[MOTOR]) - 0.3)
    recordings, (warning,) = prepare([copied], 0.3)
    assert recordings.recorded[0].link_position is None
    assert "the joint was taken as rigid" in warning
    assert prepare([copied], 0.3, "flexible")[0].recorded[0].link_position is not None
    recordings, warnings = prepare([changed()], 0.3)
    assert recordings.recorded[0].link_position is not None
    assert warnings == ()
