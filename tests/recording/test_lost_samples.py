"""Lost samples in logs with a counted time: detection and place."""

import numpy as np
import pytest

from flexid.recording.outliers import _local_inflation, all_times, even_times, lost_samples

STEP = 0.01


def motion(noise: float, seed: int = 1, rate: float = 100.0) -> np.ndarray:
    """Return positions of a swinging link and motor, shape (2, 3000), in rad."""
    rng = np.random.default_rng(seed)
    time = np.arange(3000) / rate
    motor = 0.8 * np.sin(3.0 * time) + 0.3 * np.sin(7.1 * time + 1.0)
    link = motor + 0.02 * np.sin(3.0 * time + 0.3)
    return np.stack([link, motor]) + noise * rng.standard_normal((2, len(time)))


def lost_of(positions: np.ndarray | list[np.ndarray]) -> np.ndarray:
    """Return the number lost after each sample, for positions with a counted time."""
    return lost_samples([*positions], STEP * np.arange(len(positions[0]), dtype=np.float64))


def without(positions: np.ndarray, lost: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Return positions without some samples, and the number missing after each one."""
    kept = np.delete(np.arange(positions.shape[1]), lost)
    return list(positions[:, kept]), np.diff(kept) - 1


SWING = 0.02 * np.sin(2.0 * np.pi * np.arange(3000) / 12.0)  # not described by a parabola
RESONANCE = motion(1e-5) + np.outer([1.0, -0.5], SWING)


@pytest.mark.parametrize(
    ("positions", "seed", "share"),
    [*((motion(1e-4, seed), seed, 0.8) for seed in range(5)), (RESONANCE, 7, 0.95)],
)
def test_lost_samples_are_found_where_they_are(positions: np.ndarray, seed: int, share: float):
    """Assert that most losses are found, with their number, and that no other place is named."""
    lost = np.random.default_rng(seed).choice(np.arange(10, 2990), 60, replace=False)
    kept, true = without(positions, lost)
    found = lost_of(kept)
    assert not found[true == 0].any()
    assert np.count_nonzero(found == true) > 0.99 * len(true)
    assert found.sum() > share * true.sum()


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_nothing_is_found_where_nothing_is_lost(noise: float):
    """Assert that nothing is found in smooth motion, with stop and go, or with jumps."""
    positions = motion(noise)
    for other in (positions, np.maximum(positions, 0.2), np.sign(positions)):
        assert not lost_of(other).any()


@pytest.mark.parametrize(("shift", "found"), [(1, False), (8, True)])
def test_what_happens_only_where_a_motion_turns_is_no_loss(shift: int, found: bool):
    """Assert that kinks by friction at reversals are not lost samples, and others are."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(motion(0.0)[1]))))
    lost = lost_of(without(motion(1e-5), turns[2:-2] + shift)[0])
    assert np.count_nonzero(lost) == found * len(turns[2:-2])


def test_an_error_that_is_usual_nearby_shows_less():
    """Assert that squares are normalised by nearby ones, as in the fastest part of a chirp."""
    squares = np.random.default_rng(3).chisquare(2, 2400)
    squares[2000:] *= 4.0
    found = _local_inflation(squares, 2)
    assert found[:2000] == pytest.approx(np.ones(2000), rel=0.4)
    assert found[2000:] == pytest.approx(np.full(400, 4.0), rel=0.4)
    assert found.min() == 1.0  # a calm stretch does not count more


def test_nothing_is_sought_in_other_logs():
    """Assert no losses if as many samples repeat, or if the time itself shows them."""
    positions, _ = without(motion(1e-5), np.arange(100, 2900, 140))
    repeated = [np.insert(p, np.arange(50, 2900, 140), p[50:2900:140]) for p in positions]
    assert not lost_of(repeated).any()
    positions, true = without(motion(1e-5), np.arange(100, 2900, 50))
    read = STEP * np.append(0, np.cumsum(1.0 + true))
    assert not lost_samples(positions, read).any()


def coarse(rate: float, lost: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return times in hundredths of a second, and positions, without some samples."""
    kept = np.setdiff1d(np.arange(3000), lost)
    return np.round(kept / rate, 2), [*motion(1e-4, 3, rate)[:, kept]]


@pytest.mark.parametrize("lost", [[], [*range(20, 2900, 90)]])
def test_double_steps_of_a_coarse_clock_are_no_losses(lost: list[int]):
    """Assert that 97 samples per second in whole 10 ms are even, with other losses found."""
    time, positions = coarse(97.0, np.array(lost, dtype=int))
    counted = even_times(time, positions)
    assert counted is not None
    found = all_times(counted, lost_samples(positions, counted), is_span=True)
    assert 2998 <= len(found) <= 3000
    assert 1.0 / np.diff(found).mean() == pytest.approx(97.0, rel=1e-3)


def test_positions_decide_what_double_steps_are():
    """Assert losses if positions show them, and else a coarse clock, even with random steps."""
    time, positions = coarse(100.0, np.arange(20, 3000, 32))
    assert even_times(time, positions) is None
    still = [0.0 * values for values in positions]
    assert even_times(time, still) is not None
    time = STEP * np.arange(3000, dtype=np.float64)
    for place in np.random.default_rng(5).choice(np.arange(20, 2980), 40, replace=False):
        time[place:] += STEP
    counted = even_times(time, [*motion(1e-5)])
    assert counted is not None
    np.testing.assert_allclose(np.diff(counted), np.diff(counted)[0], rtol=1e-9)
