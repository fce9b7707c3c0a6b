"""Samples that were lost while the time was counted on: found where they are, and put back."""

import numpy as np
import pytest

from flexid.recording.outliers import (
    counted_anew,
    counted_on,
    lost_by_the_clock,
    lost_samples,
    put_back,
    stamped_on,
)

STEP = 0.01


def motion(noise: float, seed: int = 1) -> np.ndarray:
    """Positions of a link and a motor that swing, shape (2, 3000), in rad."""
    rng = np.random.default_rng(seed)
    time = STEP * np.arange(3000)
    motor = 0.8 * np.sin(3.0 * time) + 0.3 * np.sin(7.1 * time + 1.0)
    link = motor + 0.02 * np.sin(3.0 * time + 0.3)
    return np.stack([link, motor]) + noise * rng.standard_normal((2, len(time)))


def clock(count: int) -> np.ndarray:
    """Times that are counted, in s."""
    return STEP * np.arange(count, dtype=np.float64)


def without(positions: np.ndarray, lost: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """The positions without some samples, and how many are missing after each that is left."""
    kept = np.delete(np.arange(positions.shape[1]), lost)
    return list(positions[:, kept]), np.diff(kept) - 1


@pytest.mark.parametrize("seed", range(5))
def test_lost_samples_are_found_where_they_are(seed: int):
    """Assert that most losses are found, with their number, and that no other place is named."""
    rng = np.random.default_rng(seed)
    lost = rng.choice(np.arange(10, 2990), 60, replace=False)
    positions, true = without(motion(1e-4, seed), lost)
    found = lost_samples(positions, clock(len(positions[0])))
    assert not found[true == 0].any()
    assert np.count_nonzero(found == true) > 0.99 * len(true)
    assert found.sum() > 0.8 * true.sum()


def test_lost_samples_of_a_resonance_are_found():
    """Assert that losses show where a dozen samples make a period, of which no parabola knows."""
    rng = np.random.default_rng(7)
    swing = 0.02 * np.sin(2.0 * np.pi * np.arange(3000) / 12.0)
    lost = rng.choice(np.arange(10, 2990), 60, replace=False)
    positions, true = without(motion(1e-5) + np.outer([1.0, -0.5], swing), lost)
    found = lost_samples(positions, clock(len(positions[0])))
    assert not found[true == 0].any()
    assert found.sum() > 0.95 * true.sum()


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_nothing_is_found_where_nothing_is_lost(noise: float):
    """Assert that a motion, one that stops dead and goes on, and one of jumps lose nothing."""
    positions = motion(noise)
    time = clock(positions.shape[1])
    assert not lost_samples(list(positions), time).any()
    for other in (np.maximum(positions, 0.2), np.sign(positions)):
        assert not lost_samples(list(other), time).any()


@pytest.mark.parametrize(("shift", "found"), [(1, False), (8, True)])
def test_what_happens_only_where_a_motion_turns_is_no_loss(shift: int, found: bool):
    """Assert that samples are not put back where friction bends a motion, and are elsewhere."""
    positions = motion(1e-5)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(motion(0.0)[1]))))
    kept, _ = without(positions, turns[2:-2] + shift)
    lost = lost_samples(kept, clock(len(kept[0])))
    assert np.count_nonzero(lost) == found * len(turns[2:-2])


def test_repeated_samples_are_no_lost_ones():
    """Assert that a log whose samples are repeated as often as lost is left alone."""
    positions, _ = without(motion(1e-5), np.arange(100, 2900, 140))
    repeated = [np.insert(p, np.arange(50, 2900, 140), p[50:2900:140]) for p in positions]
    assert not lost_samples(repeated, clock(len(repeated[0]))).any()


def test_a_clock_that_was_read_is_left_alone():
    """Assert that losses are not looked for where the time itself shows them."""
    positions, true = without(motion(1e-5), np.arange(100, 2900, 50))
    read = clock(int(true.sum()) + len(true) + 1)[np.append(0, np.cumsum(1 + true))]
    assert not lost_samples(positions, read).any()


@pytest.mark.parametrize(("every", "found"), [(50, True), (400, False)])
def test_losses_that_the_clock_shows_are_bridged_where_they_are_often(every: int, found: bool):
    """Assert that a log is not cut into pieces of less than two seconds, and else left to cuts."""
    kept = np.setdiff1d(np.arange(3000), np.arange(100, 2900, every))
    lost = lost_by_the_clock(clock(3000)[kept])
    np.testing.assert_array_equal(lost, (np.diff(kept) - 1) * found)


def coarse(rate: float, lost: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Times in hundredths of a second, and the positions, of a motion without some samples."""
    kept = np.setdiff1d(np.arange(3000), lost)
    time = kept / rate
    motor = 0.8 * np.sin(3.0 * time) + 0.3 * np.sin(7.1 * time + 1.0)
    noise = 1e-4 * np.random.default_rng(3).standard_normal((2, len(time)))
    return np.round(time, 2), [0.5 * motor + noise[0], motor + noise[1]]


@pytest.mark.parametrize("lost", [[], [*range(20, 2900, 90)]])
def test_double_steps_of_a_coarse_clock_are_no_losses(lost: list[int]):
    """Assert that 97 samples per second are these, and samples lost beside are found as such."""
    time, positions = coarse(97.0, np.array(lost, dtype=int))
    counted = counted_anew(time, positions)
    assert counted is not None
    found = counted_on(counted, lost_samples(positions, counted), is_span=True)
    assert 2998 <= len(found) <= 3000
    assert 1.0 / np.diff(found).mean() == pytest.approx(97.0, rel=1e-3)


def test_losses_that_recur_evenly_are_no_coarse_clock():
    """Assert that the positions decide where a clock alone could be either."""
    time, positions = coarse(100.0, np.arange(20, 3000, 32))
    assert counted_anew(time, positions) is None
    still = [0.0 * values for values in positions]
    assert counted_anew(time, still) is not None


def test_a_clock_that_jumps_is_counted_on_the_evidence_of_the_positions():
    """Assert that double steps at random, of which no position knows, are taken out."""
    positions, time = list(motion(1e-5)), clock(3000)
    for place in np.random.default_rng(5).choice(np.arange(20, 2980), 40, replace=False):
        time[place:] += STEP
    counted = counted_anew(time, positions)
    assert counted is not None
    np.testing.assert_allclose(np.diff(counted), np.diff(counted)[0], rtol=1e-9)


def test_what_is_put_back_is_the_motion():
    """Assert that three samples in a row return within a cubic's error, those around unchanged."""
    kept = np.setdiff1d(np.arange(3000), [100, 101, 102, 180, 250, 251, 300])
    lost = np.diff(kept) - 1
    values = motion(0.0)[0]
    found = put_back(values[kept], lost, held=False)
    np.testing.assert_array_equal(found[kept], values[kept])
    np.testing.assert_allclose(found, values, atol=1e-5)
    np.testing.assert_allclose(stamped_on(clock(3000)[kept], lost), clock(3000), atol=1e-12)


def test_the_time_is_counted_on():
    """Assert that the time grows by the steps that were put back."""
    lost = np.array([0, 2, 0])
    time = counted_on(clock(4), lost, is_span=False)
    np.testing.assert_allclose(time, clock(6), atol=1e-15)
    np.testing.assert_allclose(counted_on(time[:4], lost, is_span=True), 0.6 * clock(6), atol=1e-15)
