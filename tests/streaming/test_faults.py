"""Single faults of a stream, on a joint with known parameters, and wraps before a gear."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from moving_joint import (
    LINK,
    MOTOR,
    OPTIONS,
    TIME,
    TORQUE,
    TRUTH,
    H,
    all_hold,
    counted,
    errors,
    loaded_stream,
    stream,
    watched,
)

from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.recording.jumps import without_wraps
from flexid.streaming.guard import Counts, Guard
from flexid.streaming.health import Health
from flexid.streaming.options import WatchOptions
from flexid.streaming.session import Session

CLOSE = 0.004
"""Maximum error after eight seconds with 0.1 mrad of noise; without faults it is a fifth."""


Change = tuple[Any, Any, float]  # rows, columns, and the added value


def displaced(*changes: Change) -> np.ndarray:
    """Return the stream with these values added."""
    samples = stream()
    for rows, columns, added in changes:
        samples[rows, columns] += added
    return samples


NO_NUMBERS: tuple[Change, ...] = (
    *((slice(500, None, 700), LINK, np.nan), (slice(900, None, 700), TORQUE, np.inf)),
    (1100, MOTOR, 1e30),
)
OUTLIERS: tuple[Change, ...] = (  # used as data, they would ruin the estimate
    *((slice(300, None, 400), LINK, 0.05), (slice(500, None, 400), MOTOR, -0.02)),
)
BAD_VALUES: dict[str, tuple[tuple[Change, ...], dict[str, int]]] = {
    "none": ((), {"taken": 4001, "outliers": 0}),
    "no numbers": (NO_NUMBERS, {"no_number": 6 + 5 + 1, "gaps": 0}),  # time goes on
    "outliers": (OUTLIERS, {"outliers": 10 + 9}),
    "readings that noise may make": (((slice(300, None, 400), LINK, 2e-4),), {"outliers": 0}),
    "zeros that moved": (
        ((slice(2000, None), [LINK, MOTOR], 0.4),),
        {"jumps": 1, "outliers": 3, "taken": 3998},
    ),
}


@pytest.mark.parametrize("name", BAD_VALUES)
def test_bad_values_are_left_out(name: str):
    """Assert that bad values are counted, and hardly change the estimate."""
    changes, counts = BAD_VALUES[name]
    session = watched(displaced(*changes))
    assert {name: getattr(session.counts, name) for name in counts} == counts
    assert session.counts.fed == len(stream())
    assert session.changes == ()
    if name != "zeros that moved":  # the angle of gravity changes with the zero
        assert errors(session).max() < CLOSE
        assert session.health.health is Health.CONVERGED
    if name in ("none", "outliers"):
        assert all_hold(session)


@pytest.mark.parametrize("motor_turn", [0.0, 2.0 * np.pi / 40.0])
def test_late_and_repeated_samples_are_left_out(motor_turn: float):
    """Assert that late and repeated samples are counted, and leave the estimate unchanged."""
    clean, options = stream(), replace(OPTIONS, motor_turn=motor_turn)
    if motor_turn:
        clean[:, MOTOR] %= motor_turn
    again = np.insert(clean, 1001, clean[1000] + [1e-5, 0.0, 0.3, 0.0], axis=0)  # a repeated sample
    late = np.insert(again, 2500, clean[2000], axis=0)
    session, right = watched(late, options), watched(clean, options)
    assert session.counts.repeated == session.counts.late == 1
    assert session.counts.gaps == 0
    np.testing.assert_array_equal(session.now.states[0], right.now.states[0])


def test_a_clock_that_is_set_back_is_followed():
    """Assert that a restarted clock costs some samples and does not harm the estimate."""
    samples = np.concatenate((stream(4.0, 1), stream(4.0, 2)))
    session = watched(samples)
    assert session.counts.restarts == 1
    assert session.counts.late == 19
    assert errors(session).max() < CLOSE


def test_after_a_gap_it_is_as_if_a_new_recording_began():
    """Assert that after a gap the estimate equals the batch fit, and information adds up."""
    samples = stream(12.0)
    first, second = samples[:2500], samples[2630:]
    session = watched(np.concatenate((first, second)))
    assert (session.counts.gaps, session.counts.missing) == (1, 130)

    recordings = [
        Samples(part[:, [LINK, MOTOR]].copy(), None, part[:, [TORQUE]].copy(), H)
        for part in (first, second)
    ]
    batch = filtered_least_squares(recordings, session.learner.system, 20.0, "linear")
    values = session.learner.values(session.now.states)
    np.testing.assert_allclose(values, batch.values, rtol=1e-6)

    main = session.learner.main
    alone = [watched(part) for part in (first, second)]
    for place in range(2):
        added = sum(main.information(part.now.states[0])[place] for part in alone)
        found = main.information(session.now.states[0])[place]
        np.testing.assert_allclose(found, added, rtol=1e-6, atol=1e-9 * np.abs(added).max())


GEAR = 40.0
GEARED = replace(OPTIONS, motor_turn=2.0 * np.pi / GEAR)


def in_front_of_the_gear(turns: float) -> np.ndarray:
    """Return the stream with the motor's encoder before the gear, with a range of some turns."""
    samples = stream()
    samples[:, MOTOR] %= turns * GEARED.motor_turn
    return samples


def about_zero(begins: float) -> np.ndarray:
    """Return the stream with both encoders wrapped, the link's from an angle behind zero."""
    samples = stream()
    samples[:, LINK] = (samples[:, LINK] + begins) % (2.0 * np.pi) - begins
    samples[:, MOTOR] %= 2.0 * np.pi
    return samples


@pytest.mark.parametrize(
    ("options", "samples", "least"),
    [
        *((OPTIONS, partial(about_zero, begins), 4) for begins in (0.3, -0.3)),
        *((GEARED, partial(in_front_of_the_gear, turns), 20 / turns) for turns in (1, 4)),
    ],
    ids=["from 0.3", "from -0.3", "a turn of a gear", "four turns"],
)
def test_encoders_that_wrap_are_unwrapped(options, samples, least):
    """Assert that encoders may wrap at any time, also before a gear."""
    session, right = watched(samples(), options), watched(stream())
    assert session.counts.wraps > least
    assert session.counts.outliers == session.counts.jumps == 0
    values = [one.learner.values(one.now.states) for one in (session, right)]
    np.testing.assert_allclose(*values, rtol=1e-6)


@pytest.mark.parametrize("turns", [1, 4])
def test_bad_samples_beside_wraps_do_no_harm(turns: int):
    """Assert that wraps are counted right near outliers, missing values and a lost sample."""
    samples = in_front_of_the_gear(turns)
    session = watched(samples, GEARED)
    wraps = np.flatnonzero(np.abs(np.diff(samples[:, MOTOR])) > 0.5 * GEARED.motor_turn)
    samples[wraps[5], MOTOR] += 0.4 * GEARED.motor_turn
    samples[wraps[6], MOTOR] = np.nan
    spoilt = watched(np.delete(samples, wraps[7], axis=0), GEARED)
    assert spoilt.counts.wraps == session.counts.wraps
    assert errors(spoilt).max() < CLOSE


@pytest.mark.parametrize("column", [LINK, MOTOR])
@pytest.mark.parametrize("stuck", [0, 2600])
def test_what_a_stuck_encoder_taught_is_taken_back(stuck, column):
    """Assert that a frozen encoder is a sensor fault, and leaves the estimate unchanged."""
    samples = stream(8.0 if stuck else 12.0)
    samples[stuck:, column] = samples[stuck, column]
    session = watched(samples)
    assert session.health.health is Health.SENSOR_FAULT
    assert "stands still" in session.health.reason
    if stuck:
        assert session.counts.stuck > 0.8 * (len(samples) - stuck)
        assert errors(session).max() < CLOSE
    before = watched(samples[: stuck - stuck % session.window])
    assert stuck or session.learner.main.equations(session.now.states[0]) == 0
    np.testing.assert_array_equal(session.now.states[0], before.now.states[0])


def test_an_encoder_that_comes_back_is_learnt_from_again():
    """Assert that a fault ends with its cause, and that rest of both encoders is no fault."""
    samples = stream(12.0)
    samples[2000:3000, LINK] = samples[2000, LINK]
    session = watched(samples)
    assert session.counts.stuck > 800
    assert session.health.health is Health.CONVERGED
    assert errors(session).max() < CLOSE

    samples = stream()
    rest = np.repeat(samples[-1:], 1000, axis=0)
    rest[:, TIME] += H * np.arange(1, 1001)
    session = watched(np.concatenate((samples, rest)))
    assert session.counts.stuck == 0


def test_a_torque_sensor_at_its_limit_is_left_out():
    """Assert that clipped torque is counted, and that the other samples give the right value."""
    samples = stream()
    samples[:, TORQUE] = np.clip(samples[:, TORQUE], -22.0, 22.0)
    clipped = int(np.sum(np.abs(samples[:, TORQUE]) == 22.0))
    session = watched(samples)
    assert 0.5 * clipped < session.counts.saturated < clipped
    believed = Session(OPTIONS)
    states, _ = believed.learner.learn(believed.now.states, samples[:, 1:])
    wrong = abs(believed.learner.values(states)[4] / TRUTH["beta1"] - 1.0)
    assert errors(session)[4] < 0.5 * wrong


def test_a_load_that_is_picked_up_is_noticed_and_learnt():
    """Assert that a new load is reported within three windows, and then identified."""
    samples = loaded_stream(8.0, 10.0)
    session = Session(OPTIONS)
    session.feed(samples[: round(9.6 / H)])
    assert session.health.health is Health.INCONSISTENT
    (change,) = session.changes
    assert 8.0 < change.time <= 8.0 + 3 * session.window * H
    assert change.row == "link"
    assert "started again" in session.health.reason
    session.feed(samples[round(9.6 / H) :])
    assert session.health.health is Health.CONVERGED
    loaded = TRUTH | {"theta2": TRUTH["theta2"] / 1.5}
    assert errors(session, loaded).max() < CLOSE
    assert all_hold(session, loaded)
    assert session.n_changes == 1


RESTING = np.column_stack((stream()[:, TIME], np.full((4001, 2), 0.1), np.full(4001, 0.5)))
RESTING[:, [LINK, MOTOR]] += 1e-4 * np.random.default_rng(3).standard_normal((4001, 2))


@pytest.mark.parametrize(
    ("samples", "health", "words"),
    [
        (RESTING, Health.NOT_EXCITED, ["move"]),
        (stream() * [1.0, 1.0, 1.0, -1.0], Health.INCONSISTENT, ["beta1", "sign"]),
        (
            displaced((slice(None, None, 3), LINK, np.nan)),
            Health.SENSOR_FAULT,
            ["not finite or too large"],
        ),
        (np.delete(stream(), slice(5, None, 6), axis=0), Health.NOT_EXCITED, ["send every"]),
        (np.delete(stream(), -2, axis=0), Health.CONVERGED, ["known within"]),
    ],
    ids=[
        "a drive that stands still",
        "a torque of the wrong sign",
        "every third lost",
        "every sixth lost",
        "the last but one lost",
    ],
)
def test_what_the_health_says(samples, health: Health, words: list[str]):
    """Assert that each fault has its state, and a reason with the item to check."""
    judgement = watched(samples).health
    assert judgement.health is health
    assert all(word in judgement.reason for word in words)


def test_without_a_known_hold_the_interval_covers_both():
    """Assert that an unknown hold widens the interval."""
    samples = stream()
    known = watched(samples)
    unknown = watched(samples, WatchOptions(H, OPTIONS.terms, hold="auto"))
    widths = [np.diff(s.coefficients["beta1"].interval)[0] for s in (known, unknown)]
    assert widths[1] > 2.0 * widths[0]


def guarded(positions: np.ndarray) -> Counts:
    """Return a guard's counts for two encoders with equal readings."""
    guard = Guard(OPTIONS)
    return counted(guard, H * np.arange(len(positions)), positions, positions)


def test_what_is_unusual_is_believed_after_the_first_time():
    """Assert that accelerations, and steps of a coarse encoder, are rejected three times only."""
    time = H * np.arange(4000)
    position = np.zeros(4000)
    for start in (2.0, 6.0):
        since = np.clip(time - start, 0.0, 0.2)
        position += 50.0 * since**2 - 100.0 * np.clip(since - 0.1, 0.0, 0.1) ** 2
    counts = guarded(position + 1e-6 * np.random.default_rng(5).standard_normal(4000))
    assert (counts.outliers, counts.jumps) == (3, 1)
    link = 0.02 * np.sin(0.5 * H * np.arange(6000))
    assert guarded(np.round(link / 1.5e-3) * 1.5e-3).outliers == 3


TURN = 0.1


def moved(peak: float, count: int = 900) -> np.ndarray:
    """Return positions of a motor from rest, with at most this many turns per sample."""
    rate = 2.0 * np.pi / 300.0
    noise = 1e-3 * np.random.default_rng(1).standard_normal(count)
    return TURN * (peak / rate * (1.0 - np.cos(rate * np.arange(count))) + noise)


CLOCK = 0.01 * np.arange(900.0)
GUARD = Guard(WatchOptions(0.01, (), "rigid", filter_rate=5.0, motor_turn=TURN))


@pytest.mark.parametrize("turns", [1, 4])
@pytest.mark.parametrize("peak", [0.2, 0.3, 0.45, 0.7])
def test_a_fast_motor(peak: float, turns: int):
    """Assert that no turn is lost, for fast motion and missing samples."""
    position = moved(peak)
    kept = np.random.default_rng(2).random(len(position)) >= 0.02
    time, readings = CLOCK[kept], np.mod(position, turns * TURN)[kept]
    found, period = without_wraps(time, readings, TURN)
    assert np.ptp((found - position[kept])[1:]) < 1e-9
    assert period == pytest.approx(turns * TURN)
    counts = counted(GUARD, time, readings)
    assert counts.wraps > 20 * peak


@pytest.mark.parametrize("peak", [0.3, 0.7])
def test_a_fast_motor_whose_encoder_does_not_wrap(peak: float):
    """Assert that an encoder without wraps is unchanged, at any speed from its first sample."""
    readings = moved(peak)[75:]
    found, period = without_wraps(CLOCK[75:], readings, TURN)
    np.testing.assert_array_equal(found, readings)
    counts = counted(GUARD, CLOCK[75:], readings)
    assert (period, counts.wraps) == (0.0, 0)


def test_what_only_looks_like_a_wrap():
    """Assert turns despite single outliers, and none if the readings exceed a turn."""
    position = moved(0.3)
    readings = np.mod(position, TURN)
    bad = np.arange(10, 880, 20)
    off = np.resize([0.2, -0.2, 0.15, 0.3, 0.5, -0.4], len(bad))
    readings[bad] = np.mod(position[bad] + TURN * off, TURN)
    found, _ = without_wraps(CLOCK, readings, TURN)
    assert np.ptp(np.delete(found - position, bad)[1:]) < 1e-9
    readings = np.array([0.0, 0.1, 0.105, 0.12, 0.13, 0.14])
    found, period = without_wraps(CLOCK[:6], readings, 0.1)
    np.testing.assert_array_equal(found, readings)
    assert period == 0.0
