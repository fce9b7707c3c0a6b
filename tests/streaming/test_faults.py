"""One fault of a stream after the other, each on a joint whose truth is known."""

from dataclasses import replace
from pathlib import Path

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
    errors,
    loaded_stream,
    same,
    stream,
    watched,
)

from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.streaming.checkpoint import read_session, save_session
from flexid.streaming.gear_wraps import GearWraps
from flexid.streaming.guard import Guard
from flexid.streaming.health import Health
from flexid.streaming.options import WatchOptions
from flexid.streaming.session import Session

CLOSE = 0.004
"""Errors of eight seconds at 0.1 mrad, at most; without faults they are five times as small."""


def damaged(damage) -> np.ndarray:
    """The stream after something was done to it in place."""
    samples = stream()
    damage(samples)
    return samples


def test_nothing_is_wrong_with_a_clean_stream():
    """Assert that every sample is taken, that it converges, and that the intervals hold."""
    session = watched(stream())
    assert session.counts.taken == session.counts.fed == len(stream())
    assert session.health.health is Health.CONVERGED
    assert errors(session).max() < CLOSE
    assert all_hold(session)
    assert session.changes == ()


def test_numbers_that_are_none_are_left_out():
    """Assert that they are counted, and cost hardly anything."""

    def damage(samples):
        samples[500::700, LINK] = np.nan
        samples[900::700, TORQUE] = np.inf
        samples[1100, MOTOR] = 1e30

    session = watched(damaged(damage))
    assert session.counts.no_number == len(range(500, 4001, 700)) + len(range(900, 4001, 700)) + 1
    assert session.counts.gaps == 0  # the clock went on
    assert errors(session).max() < CLOSE
    assert session.health.health is Health.CONVERGED


def test_outliers_are_left_out():
    """Assert that single readings that jump are counted; learnt from, they would spoil it all."""

    def damage(samples):
        samples[300::400, LINK] += 0.05
        samples[500::400, MOTOR] -= 0.02

    session = watched(damaged(damage))
    assert session.counts.outliers == 10 + 9
    assert errors(session).max() < CLOSE
    assert all_hold(session)


def test_an_outlier_within_the_noise_is_taken():
    """Assert that what noise may do is no outlier: the other side of the gate."""

    def damage(samples):
        samples[300::400, LINK] += 2e-4

    assert watched(damaged(damage)).counts.outliers == 0


def test_a_reading_that_jumps_for_good_is_believed():
    """Assert that a motion that goes on elsewhere is followed: an encoder whose zero was moved."""

    def damage(samples):
        samples[2000:, [LINK, MOTOR]] += 0.4 * np.ones(2)

    session = watched(damaged(damage))
    assert session.counts.jumps == 1
    assert session.counts.outliers == 3
    assert session.counts.taken == len(stream()) - 3


def test_late_and_repeated_samples_are_left_out():
    """Assert that they are counted, and that the estimate is that without them, bit for bit."""
    clean = stream()
    again = np.insert(clean, 1001, clean[1000], axis=0)  # repeated
    late = np.insert(again, 2500, clean[2000], axis=0)
    session, right = watched(late), watched(clean)
    assert session.counts.repeated == session.counts.late == 1
    assert session.counts.gaps == 0
    np.testing.assert_array_equal(session.now.states[0], right.now.states[0])


def test_a_clock_that_is_set_back_is_followed():
    """Assert that a recorder which begins anew costs some samples and spoils nothing."""
    samples = np.concatenate((stream(4.0, 1), stream(4.0, 2)))
    session = watched(samples)
    assert session.counts.restarts == 1
    assert session.counts.late == 19
    assert errors(session).max() < CLOSE


def test_after_a_gap_it_is_as_if_a_new_recording_began():
    """Assert that a gap leaves least squares of two recordings: what was learnt from each, added.

    The batch, which takes the two as recordings of their own, finds the same; and the information
    is the sum of that of two sessions that know nothing of each other.
    """
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


def test_a_gap_that_is_hidden_would_corrupt_the_estimate():
    """Assert that the test above can fail: with even times over a gap the estimate is spoilt."""
    samples = stream(12.0)
    hidden = np.concatenate((samples[:2500], samples[2630:]))
    hidden[:, TIME] = H * np.arange(len(hidden))
    # The guard sees the jump even so, but for one that the motion could have made.
    session = watched(hidden)
    assert session.counts.gaps == 0
    assert session.counts.outliers == 3


def test_encoders_that_wrap_are_unwrapped():
    """Assert that an absolute encoder may pass its zero at any time."""

    def damage(samples):
        samples[:, LINK] = (samples[:, LINK] + 0.3) % (2.0 * np.pi) - 0.3
        samples[:, MOTOR] %= 2.0 * np.pi

    session, right = watched(damaged(damage)), watched(stream())
    assert session.counts.wraps > 4
    assert session.counts.outliers == 0
    np.testing.assert_allclose(
        session.learner.values(session.now.states),
        right.learner.values(right.now.states),
        rtol=1e-6,
    )


GEAR = 40.0
GEARED = replace(OPTIONS, motor_turn=2.0 * np.pi / GEAR)


def in_front_of_the_gear(turns: float, samples: np.ndarray) -> None:
    """Let the motor's encoder stand there, and wrap after so many turns."""
    samples[:, MOTOR] %= turns * GEARED.motor_turn


@pytest.mark.parametrize("turns", [1, 4])
def test_encoders_that_wrap_in_front_of_a_gear_are_unwrapped(turns: int):
    """Assert that they are by the motor's turns, and that bad samples beside do no harm."""
    samples, right = stream(), watched(stream())
    in_front_of_the_gear(turns, samples)
    session = watched(samples, GEARED)
    assert session.counts.wraps > 20 / turns
    assert session.counts.outliers == session.counts.jumps == 0
    np.testing.assert_allclose(
        session.learner.values(session.now.states),
        right.learner.values(right.now.states),
        rtol=1e-6,
    )
    wraps = np.flatnonzero(np.abs(np.diff(samples[:, MOTOR])) > 0.5 * GEARED.motor_turn)
    samples[wraps[5], MOTOR] += 0.4 * GEARED.motor_turn
    samples[wraps[6], MOTOR] = np.nan
    spoilt = watched(np.delete(samples, wraps[7], axis=0), GEARED)
    assert spoilt.counts.wraps == session.counts.wraps
    assert errors(spoilt).max() < CLOSE


def test_blocks_and_checkpoints_leave_the_turns_as_they_are(tmp_path: Path):
    """Assert that a session that is saved between two turns goes on bit for bit."""
    samples = stream()
    in_front_of_the_gear(1, samples)
    first = watched(samples[:2001], GEARED)
    save_session(first, tmp_path / "state.json")
    again = read_session(tmp_path / "state.json")
    for row in samples[2001:2100]:
        again.feed(row[None])
    again.feed(samples[2100:])
    assert same(again, watched(samples, GEARED))


def test_a_motor_in_front_of_a_gear_that_does_not_wrap_is_left_alone():
    """Assert that a counter of all turns is read as it is, where it jumps by a turn, too."""
    samples = stream()
    samples[2000:, MOTOR] += GEARED.motor_turn
    session, right = watched(samples, GEARED), watched(samples)
    assert session.counts == right.counts
    np.testing.assert_array_equal(session.now.states[0], right.now.states[0])


def test_an_encoder_that_leaves_its_turn_does_not_wrap():
    """Assert that what looked like a wrap is taken back where the range shows that it was none."""
    wraps = GearWraps(0.1, H, MOTOR)
    samples = np.zeros((6, 4))
    samples[:, TIME] = H * np.arange(6)
    samples[:, MOTOR] = [0.0, 0.1, 0.105, 0.12, 0.13, 0.14]
    right = [0.0, 0.0, 0.105, 0.12, 0.13, 0.14]
    np.testing.assert_array_equal(wraps.undone(samples)[:, MOTOR], right)


@pytest.mark.parametrize("column", [LINK, MOTOR])
def test_what_a_stuck_encoder_taught_is_taken_back(column):
    """Assert that an encoder that freezes is a sensor fault, and leaves the estimate as it was."""
    samples = stream()
    stuck = 2600
    samples[stuck:, column] = samples[stuck, column]
    session = watched(samples)
    assert session.health.health is Health.SENSOR_FAULT
    assert "stands still" in session.health.reason
    assert session.counts.stuck > 0.8 * (len(samples) - stuck)
    assert errors(session).max() < CLOSE
    before = watched(samples[: stuck - stuck % session.window])
    np.testing.assert_array_equal(session.now.states[0], before.now.states[0])


@pytest.mark.parametrize("column", [LINK, MOTOR])
def test_a_dead_encoder_teaches_nothing(column):
    """Assert that nothing is known where an encoder never moved, however long that took to see."""
    samples = stream(12.0)
    samples[:, column] = samples[0, column]
    session = watched(samples)
    assert session.health.health is Health.SENSOR_FAULT
    assert session.learner.main.equations(session.now.states[0]) == 0


def test_an_encoder_that_comes_back_is_learnt_from_again():
    """Assert that the fault ends with its cause."""
    samples = stream(12.0)
    samples[2000:3000, LINK] = samples[2000, LINK]
    session = watched(samples)
    assert session.counts.stuck > 800
    assert session.health.health is Health.CONVERGED
    assert errors(session).max() < CLOSE


def test_an_encoder_at_rest_is_not_stuck():
    """Assert that both may stand still together."""
    samples = stream()
    rest = np.repeat(samples[-1:], 1000, axis=0)
    rest[:, TIME] += H * np.arange(1, 1001)
    session = watched(np.concatenate((samples, rest)))
    assert session.counts.stuck == 0


def test_a_torque_sensor_at_its_limit_is_left_out():
    """Assert that clipped torque is counted, and that what is left gives the right answer.

    Taken for true, it makes the motor's inertia 4 % wrong.
    """

    def damage(samples):
        samples[:, TORQUE] = np.clip(samples[:, TORQUE], -22.0, 22.0)

    samples = damaged(damage)
    clipped = int(np.sum(np.abs(samples[:, TORQUE]) == 22.0))
    session = watched(samples)
    assert 0.5 * clipped < session.counts.saturated < clipped
    believed = Session(OPTIONS)
    states, _ = believed.learner.learn(believed.now.states, samples[:, 1:])
    wrong = abs(believed.learner.values(states)[4] / TRUTH["beta1"] - 1.0)
    assert errors(session)[4] < 0.5 * wrong


def test_a_load_that_is_picked_up_is_noticed_and_learnt():
    """Assert that it is said within two windows and one more, and that the new load is found."""
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


def test_a_drive_at_rest_is_not_excited():
    """Assert that a drive that stands still, but for noise, is said to need motion."""
    samples = stream()
    samples[:, [LINK, MOTOR]] = 0.1 + 1e-4 * np.random.default_rng(3).standard_normal(
        (len(samples), 2)
    )
    samples[:, TORQUE] = 0.5
    judgement = watched(samples).health
    assert judgement.health is Health.NOT_EXCITED
    assert "move" in judgement.reason


def test_a_torque_of_the_wrong_sign_is_inconsistent():
    """Assert that an inertia that comes out negative is refused, with what to check."""
    samples = stream()
    samples[:, TORQUE] *= -1.0
    judgement = watched(samples).health
    assert judgement.health is Health.INCONSISTENT
    assert "beta1" in judgement.reason
    assert "sign" in judgement.reason


def test_many_bad_samples_are_a_sensor_fault():
    """Assert that a line which loses every third sample is one, and names what it does."""
    samples = stream()
    samples[::3, LINK] = np.nan
    judgement = watched(samples).health
    assert judgement.health is Health.SENSOR_FAULT
    assert "not a number" in judgement.reason
    few = stream()
    few[::10, LINK] = np.nan
    assert watched(few).health.health is not Health.SENSOR_FAULT


def test_without_a_known_hold_the_interval_covers_both():
    """Assert that the interval is wider by what the hold matters."""
    samples = stream()
    known = watched(samples)
    unknown = watched(samples, WatchOptions(H, OPTIONS.terms, hold="auto"))
    widths = [np.diff(s.coefficients["beta1"].interval)[0] for s in (known, unknown)]
    assert widths[1] > 2.0 * widths[0]


def test_a_drive_that_starts_with_a_jerk_is_believed_after_the_first_time():
    """Assert that accelerations that no sample before had are refused three times, and then known.

    Not once more at the next jerk, after seconds at rest.
    """
    time = H * np.arange(4000)
    position = np.zeros(4000)
    for start in (2.0, 6.0):
        since = np.clip(time - start, 0.0, 0.2)
        position += 50.0 * since**2 - 100.0 * np.clip(since - 0.1, 0.0, 0.1) ** 2
    position += 1e-6 * np.random.default_rng(5).standard_normal(4000)
    guard = Guard(H, 2, 1, from_deflection=False)
    samples = np.column_stack((time, position, position, np.sin(time))).astype(np.float64)
    counts = guard.counts(guard.guard(guard.first_state(), samples).state)
    assert (counts.outliers, counts.jumps) == (3, 1)


def test_steps_of_a_coarse_encoder_are_no_outliers():
    """Assert that an encoder that shows a step now and then is refused at the first one alone."""
    time = H * np.arange(6000)
    link = 0.02 * np.sin(0.5 * time)
    coarse = np.round(link / 1.5e-3) * 1.5e-3
    guard = Guard(H, 2, 1, from_deflection=False)
    samples = np.column_stack((time, coarse, coarse, np.sin(time))).astype(np.float64)
    counts = guard.counts(guard.guard(guard.first_state(), samples).state)
    assert counts.outliers == 3
