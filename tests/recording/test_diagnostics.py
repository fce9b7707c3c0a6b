"""Faulty logs of a known joint: each fault alone is named."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from joint_log import read_columns, said
from scipy import signal
from tests.identification.made_joint import made

from flexid.arrays import FloatArray
from flexid.identification.preparation.recordings import prepare
from flexid.library.logs import read_log
from flexid.recording import Log
from flexid.recording.recording import Rank, rank_of
from flexid.recording.slow_motion import is_of_the_spring, late_input, scales_apart
from flexid.recording.velocities import is_noise

STEP = 2e-3  # s
COUNT = 6000
NOISE = 1e-5  # rad
LINK, MOTOR, TORQUE = "link_position [rad]", "motor_position [rad]", "motor_torque [N m]"
LINK_SPEED, MOTOR_SPEED = "link_velocity [rad/s]", "motor_velocity [rad/s]"

Columns = dict[str, FloatArray]


def simulated(size: float = 1.0) -> Columns:
    """Return 12 s of a joint with gravity, friction and white noise on its sensors."""
    motion = made(1, 12.0, noise=0.0, size=size)
    link, motor = motion.needed_link_position, motion.motor_position
    noise = np.random.default_rng(1).standard_normal((4, COUNT))
    return {
        "time [s]": STEP * np.arange(COUNT, dtype=np.float64),
        LINK: link + NOISE * noise[0],
        MOTOR: motor + NOISE * noise[1],
        TORQUE: motion.needed_input,
        LINK_SPEED: np.gradient(link, STEP) + 1e-3 * noise[2],
        MOTOR_SPEED: np.gradient(motor, STEP) + 1e-3 * noise[3],
    }


CLEAN = simulated()
POSITIONS = ("time [s]", LINK, MOTOR, TORQUE)
Change = Callable[[FloatArray], FloatArray]


def with_changes(**changes: Change) -> Columns:
    """Return the log without velocities, with some channels changed."""
    columns = {name: CLEAN[name].copy() for name in POSITIONS}
    for name, change in changes.items():
        column = {"link": LINK, "motor": MOTOR, "torque": TORQUE}[name]
        columns[column] = change(columns[column])
    return columns


def changed(**changes: Change) -> Log:
    """Read the log with some channels changed."""
    return read_log(with_changes(**changes))


def times(factor: float) -> Change:
    """Return a function that scales a channel."""
    return lambda values: factor * values


def held(first: int, last: int) -> Change:
    """Return a function that repeats one sample."""
    return lambda values: np.r_[values[:first], np.full(last - first, values[first]), values[last:]]


def spiked(places: list[int], size: float) -> Change:
    """Return a function that displaces single samples."""
    return lambda values: values + size * np.isin(np.arange(COUNT), places)


def without_every(every: int) -> Columns:
    """Return the log without some samples, with the time counted from the rest."""
    kept = np.arange(COUNT) % every != every - 1
    columns = {name: CLEAN[name][kept] for name in POSITIONS}
    return columns | {"time [s]": STEP * np.arange(kept.sum())}


def clock_without(every: int) -> Columns:
    """Return the log without one or three samples in places, with the true times."""
    places = np.arange(1000, COUNT, every)
    gone = np.concatenate([places, places[::2] + 1, places[::2] + 2])
    return {name: np.delete(CLEAN[name], gone) for name in POSITIONS}


def stopped(power: int, part: float) -> Columns:
    """Return a log with a jump of position, velocity or acceleration."""
    after = np.maximum(np.arange(COUNT) - 3000.0 - part, 0.0)
    jump = 0.01 * np.sign(after) * after**power
    return with_changes(link=lambda q: q + jump, motor=lambda q: q + jump)


def stuck_for_a_while() -> Columns:
    """Return a link that rests and then moves on smoothly, while the motor winds up."""
    at, link, motor = 3000, CLEAN[LINK].copy(), CLEAN[MOTOR].copy()
    link[at : at + 200] = link[at]
    link[at + 200 :] = link[at] + 0.3 * (STEP * np.arange(COUNT - at - 200)) ** 2
    motor[at : at + 200] = np.linspace(motor[at], motor[at] + 0.02, 200)
    return with_changes(link=lambda _: link, motor=lambda _: motor)


def noise(_: FloatArray) -> FloatArray:
    """Return white noise about a constant."""
    return 0.3 + NOISE * np.random.default_rng(5).standard_normal(COUNT)


SMALL = simulated(0.1)
CONTROLLED = -30.0 * CLEAN[MOTOR] - 2.0 * CLEAN[MOTOR_SPEED]
SPIKES = with_changes(link=spiked([900, 2000, 3333], 0.05), motor=spiked([2500], 40.0))
SMALL_MOTION = {name: SMALL[name] * (1.02 if name == MOTOR else 1.0) for name in POSITIONS}
WHITE = np.random.default_rng(8).standard_normal(COUNT)
UNITS = {"radians": np.pi / 180.0, "degrees": 180.0 / np.pi, "turns": 0.5 / np.pi}
CASES: dict[str, Columns] = {
    "a right log": with_changes(),
    "one with velocities": CLEAN,
    "a link that moves 0.5 % more": with_changes(link=times(1.005)),
    "0.2 %": with_changes(link=times(1.002)),
    "a motor that moves 2 % more": with_changes(motor=times(1.02)),
    "2 % less": with_changes(motor=times(1.0 / 1.02)),
    "half as much": with_changes(motor=times(0.5)),
    "2 % of a small motion": SMALL_MOTION,  # its angle is too close to its sine
    # Proportional to angle and velocity, this is not gravity in degrees.
    "a controller": with_changes(torque=lambda _: CONTROLLED),
    "a spike in noise": with_changes(link=spiked([900], 40.0 * NOISE)),
    "what noise may have moved": with_changes(link=spiked([900], 10.0 * NOISE)),
    "spikes": SPIKES,
    **{f"a stop, {n}, {part}": stopped(n, part) for n in (0, 1, 2) for part in (0.0, 0.5)},
    # A side that rests to the end may be held by a brake.
    "a sensor that dies": with_changes(motor=held(5000, COUNT)),
    **{
        f"a {side} stuck from {first} on": with_changes(**{side: held(first, first + 150)})
        for side in ("link", "motor")
        for first in (2000, 3200)
    },
    "a link that sticks": stuck_for_a_while(),
    "noise of a motor": with_changes(motor=noise),
    "noise of a link": with_changes(link=noise),
    "velocities of the other sides": CLEAN
    | {LINK_SPEED: CLEAN[MOTOR_SPEED], MOTOR_SPEED: CLEAN[LINK_SPEED]},
    "a velocity that is scaled": CLEAN | {LINK_SPEED: 1.28 * CLEAN[LINK_SPEED]},
    "a velocity that is late": CLEAN | {MOTOR_SPEED: np.roll(CLEAN[MOTOR_SPEED], 10)},
    "one that is 2 ms late": CLEAN | {MOTOR_SPEED: np.roll(CLEAN[MOTOR_SPEED], 1)},
    "a torque that is a speed": with_changes(torque=lambda _: CLEAN[MOTOR_SPEED]),
    "a torque that is a position": with_changes(torque=lambda _: CLEAN[LINK] + 1e-4 * WHITE),
    "a velocity of noise": CLEAN | {LINK_SPEED: WHITE},
    "one missing sample": {name: np.delete(CLEAN[name], 3000) for name in POSITIONS},
    **{
        f"{unit} taken for others": with_changes(link=times(f), motor=times(f))
        for unit, f in UNITS.items()
    },
    **{f"every {every}th lost": without_every(every) for every in (33, 2500)},
    **{f"losses every {every}": clock_without(every) for every in (600, 1200)},
}


def test_faults_of_a_known_joint(golden: Any):
    """Assert that each fault is named once, and that a velocity is used unless it is wrong."""
    golden({name: said(read_columns, columns) for name, columns in CASES.items()})


@pytest.mark.parametrize(("jump", "told"), [(1, False), (2, False), (4, True)])
def test_a_motor_that_friction_clamps_is_no_stuck_sensor(jump: int, told: bool):
    """Assert that a few steps of the encoder are no jump after 60 equal samples."""
    at, step = 1000, 360.0 / 2**18  # degrees, printed with five digits
    fades = np.exp(-STEP * np.arange(COUNT) / 0.5) * 180.0 / np.pi / step
    place = np.round(fades * CLEAN[MOTOR])
    place[at : at + 60] = place[at]
    place[at + 60 :] = place[at] + jump + np.minimum(np.arange(COUNT - at - 60) // 20, 9)
    places = {"link": np.round(fades * CLEAN[LINK]), "motor": place}
    read = {side: np.deg2rad(np.round(step * own, 5)) for side, own in places.items()}
    found = read_columns(with_changes(**{side: lambda _, q=q: q for side, q in read.items()}))
    assert any("as if the sensor was stuck" in warning for warning in found.warnings) == told


@pytest.mark.parametrize(("swaps", "told"), [(False, False), (True, True)])
def test_sides_that_swing_in_two_modes_follow_each_other(swaps: bool, told: bool):
    """Assert that a release of one joint gives no warning, and sides of two joints do."""
    moves = []
    for stiffness in (100.0, 260.0):
        law = np.array([[stiffness + 5.0, -stiffness], [-stiffness, stiffness + 30.0]])
        squares, modes = np.linalg.eig(np.diag([1.0, 1.0 / 0.3]) @ law)
        sizes = np.linalg.solve(modes, [0.2, -0.15])
        moves.append(modes * sizes @ np.cos(np.sqrt(squares)[:, None] * STEP * np.arange(COUNT)))
    link, motor = moves[0][0], moves[swaps][1]
    assert abs(np.corrcoef(link, motor)[0, 1]) < 0.3
    found = read_columns({"time [s]": CLEAN["time [s]"], LINK: link, MOTOR: motor})
    assert any("hardly follow" in warning for warning in found.warnings) == told


@pytest.mark.parametrize("factor", [1.0, -1.0, 180.0 / np.pi, -180.0 / np.pi])
def test_a_deflection_in_degrees(factor: float):
    """Assert a warning of a deflection in degrees without a unit, with either sign."""
    columns = simulated(0.05)
    bent = factor * (columns.pop(LINK) - columns[MOTOR])
    del columns[LINK_SPEED], columns[MOTOR_SPEED]
    log = read_columns({**columns, "deflection": bent})
    named = ["as if these were degrees" in warning for warning in log.warnings]
    assert sum(named) == (abs(factor) > 1.0)


@pytest.mark.parametrize("hardening", [0.0, 0.3])
@pytest.mark.parametrize("motor_inertia", [0.0, 0.05])
def test_the_torque_of_a_spring_is_no_motors(hardening: float, motor_inertia: float):
    """Assert that a motor shows in its torque, with a linear or a hardening spring."""
    time, tones = 0.002 * np.arange(6000), np.array([2.0, 7.3, 16.0])
    motion = 0.3 * np.sin(np.outer(time, tones))
    link, torque = motion.sum(axis=1), -motion @ tones**2
    bent = torque / 400.0
    spring = torque * (1.0 + hardening * (bent / bent.max()) ** 2)
    motor = link + bent
    pushed = spring + motor_inertia * np.gradient(np.gradient(motor, 0.002), 0.002)
    noise = NOISE * np.random.default_rng(1).standard_normal((2, len(time)))
    columns = {"time": time, LINK: link + noise[0], MOTOR: motor + noise[1], TORQUE: pushed}
    (recording,) = read_columns(columns).recordings
    assert is_of_the_spring(recording) == (motor_inertia == 0.0)


LATE = {25: "-0.05", -51: "0.102", 10: ""}  # by delay in samples
BEGINNING = CLEAN[TORQUE] * (np.arange(COUNT) < 50)


@pytest.mark.parametrize(
    ("torque", "delay"),
    [*((np.roll(CLEAN[TORQUE], n), d) for n, d in LATE.items()), (BEGINNING, "")],
)
def test_an_input_that_is_far_off_in_time(torque: FloatArray, delay: str):
    """Assert that a delay beyond the range of fits is named to the sample, and no other."""
    log = changed(torque=lambda _: torque)
    assert log.warnings == ()
    found = [*late_input(log.recordings[0])]
    assert len(found) == bool(delay)
    for warning in found:
        assert f"give --input-delay={delay}" in warning
        assert rank_of(warning) == Rank.SCALE


def test_what_only_looks_like_a_fault_is_not_named():
    """Assert no other scale for a hardening spring, and no delay of a single step."""
    time, tones = 0.005 * np.arange(20000), np.array([2.0, 7.3])
    motion = 0.4 * np.sin(np.outer(time, tones))
    link, acceleration = motion.sum(axis=1), -motion @ tones**2
    load = acceleration + 5.0 * np.sin(link)
    noise = NOISE * np.random.default_rng(1).standard_normal(len(time))
    motor = link + load / 100.0 * (1.0 + 5e-4 * load**2) + noise
    columns = {"time": time, "link_position": link, "motor_position": motor}
    assert read_columns({**columns, "motor_torque": load}).warnings == ()
    step = made(1, 4.0, noise=0.0, held=True, torque=lambda at: np.where(at > 0.2, 5.0, 0.0))
    assert [*late_input(step)] == []


def test_a_link_that_rests_has_no_other_scale():
    """Assert no other scale for a link that hardly moves, behind a spring of 0.7 rad/s."""
    time, tones, noise = 0.002 * np.arange(20000), np.array([8.0, 13.6]), 3e-4
    waves = np.sin(np.outer(time, tones)) * [0.6, 0.3]
    motor, link = waves.sum(axis=1), -waves @ (0.5 / (tones**2 - 0.5))
    seen = noise * np.random.default_rng(1).standard_normal((2, len(time)))
    columns = {"time": time, "link_position": link + seen[0], "motor_position": motor + seen[1]}
    (recording,) = read_columns({**columns, "motor_torque": -waves @ tones**2}).recordings
    assert scales_apart(recording) == (0.0, 0.0)


def test_damping_of_the_spring_is_no_scale():
    """Assert no other scale for a well-damped joint that follows a square wave."""
    time, motor, spring = 0.002 * np.arange(10000), 7.5, 50.0  # rad/s: the loop, the joint
    goal = 0.8 * signal.square(2.0 * np.pi * time / 2.5)
    moved = signal.lsim(([motor**2], [1.0, 1.8 * motor, motor**2]), goal, time)[1]
    damped, losses = spring, 0.5  # 1/s, of the spring and of the link
    link = signal.lsim(([damped, spring**2], [1.0, damped + losses, spring**2]), moved, time)[1]
    noise = 2e-4 * np.random.default_rng(1).standard_normal((2, len(time)))
    columns = {"time": time, "link_position": link + noise[0], "motor_position": moved + noise[1]}
    (recording,) = read_columns({**columns, "motor_torque": goal}).recordings
    assert scales_apart(recording) == (0.0, 0.0)


def test_what_is_lost_or_spiked_is_interpolated():
    """Assert lost samples at their places, and values for spikes, to some 10 times the noise."""
    log = read_log(without_every(33))
    (recording,) = log.recordings
    assert len(recording) > len(without_every(33)[LINK])
    part = slice(0, COUNT // 3)
    found = recording.needed_link_position[part]
    np.testing.assert_allclose(found, CLEAN[LINK][part], atol=20 * NOISE)
    (recording,) = read_log(clock_without(600)).recordings
    np.testing.assert_allclose(recording.time, CLEAN["time [s]"], atol=1e-9)
    np.testing.assert_allclose(recording.motor_position, CLEAN[MOTOR], atol=20 * NOISE)
    (recording,) = read_log(SPIKES).recordings
    np.testing.assert_allclose(recording.needed_link_position, CLEAN[LINK], atol=10 * NOISE)
    np.testing.assert_allclose(recording.motor_position, CLEAN[MOTOR], atol=10 * NOISE)


@pytest.mark.parametrize("part", [0.3, 0.6, 0.8])
def test_a_spike_within_the_range_is_replaced(part: float):
    """Assert that a spike is replaced, however large, that does not leave the range of motion."""
    low, extent = float(CLEAN[LINK].min()), float(np.ptp(CLEAN[LINK]))
    place = 1000 + int(np.argmin(np.abs(CLEAN[LINK][1000:5000] - low - 0.15 * extent)))
    (recording,) = changed(link=spiked([place], part * extent)).recordings
    np.testing.assert_allclose(recording.needed_link_position, CLEAN[LINK], atol=10 * NOISE)


def test_a_deflection_of_noise_alone_is_a_rigid_joint():
    """Assert that a joint counts as rigid if the encoders differ by noise alone."""
    copied = changed(link=lambda _: CLEAN[MOTOR] + noise(CLEAN[MOTOR]) - 0.3)
    recordings, (warning,) = prepare([copied], 0.3)
    assert recordings.recorded[0].link_position is None
    assert "the joint was taken as rigid" in warning
    assert prepare([copied], 0.3, "flexible")[0].recorded[0].link_position is not None
    recordings, warnings = prepare([changed()], 0.3)
    assert recordings.recorded[0].link_position is not None
    assert warnings == ()


@pytest.mark.parametrize(("deflection", "rigid"), [(0.1, True), (0.5, False)])
def test_a_deflection_below_an_encoder_step_is_a_rigid_joint(deflection, rigid):
    """Assert that single steps of coarse encoders are no deflection, unless a sensor measured it.

    The deflection is given in steps.
    """
    step = 0.02
    bent = deflection * step * np.sin(3.0 * CLEAN[TORQUE] / np.abs(CLEAN[TORQUE]).max())
    motor, link = (np.round(each / step) * step for each in (CLEAN[MOTOR] + bent, CLEAN[MOTOR]))
    coarse = changed(link=lambda _: link, motor=lambda _: motor)
    assert not is_noise(motor - link)
    recordings, warnings = prepare([coarse], 0.3)
    assert (recordings.recorded[0].link_position is None) == rigid
    assert len(warnings) == rigid
    measured = [replace(own, link_from_deflection=True) for own in coarse.recordings]
    (kept,) = prepare([replace(coarse, recordings=tuple(measured))], 0.3)[0].recorded
    assert kept.link_position is not None
