"""Stamps that are late by chance, in logs that lack samples too."""

import numpy as np
import pytest
from joint_log import joint_columns, read_columns, without

from flexid.arrays import FloatArray
from flexid.recording.late_stamps import even_with_losses

STEP, COUNT = 0.004, 4000
TRUE = STEP * np.arange(COUNT, dtype=np.float64)
COLUMNS = without(joint_columns(COUNT, STEP), "velocity")


def late(times: FloatArray, jitter: float, seed: int = 3) -> FloatArray:
    """Return times stamped too late by a half-normal part of a sample time."""
    return times + STEP * np.abs(np.random.default_rng(seed).normal(0.0, jitter, len(times)))


def kept(share: float, seed: int = 8) -> np.ndarray:
    """Return the numbers of the samples that are left where a share is lost, but for the ends."""
    left = np.random.default_rng(seed).random(COUNT) >= share
    left[[0, -1]] = True
    return np.flatnonzero(left)


@pytest.mark.parametrize("share", [0.005, 0.02, 0.1])
@pytest.mark.parametrize("jitter", [0.05, 0.15, 0.2])
def test_lost_samples_are_found_among_late_stamps(share: float, jitter: float):
    """Assert that even times differ from the true ones by a constant."""
    left = kept(share)
    even = even_with_losses(late(TRUE[left], jitter))
    assert even is not None
    off = even - TRUE[left]
    assert np.ptp(off) < 0.01 * STEP
    assert abs(np.median(off)) < jitter * STEP


def test_each_part_between_pauses_has_its_own_first_time():
    """Assert that a pause of any length is kept, as are the losses after it."""
    left = kept(0.02)
    times = TRUE[left] + 1.2345 * (left > COUNT // 3)
    even = even_with_losses(late(times, 0.1))
    assert even is not None
    assert np.ptp(even - times) < 0.03 * STEP


@pytest.mark.parametrize(
    "stamps",
    [
        late(TRUE, 0.15),  # nothing is lost
        TRUE[kept(0.02)],  # no stamp is late
        np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, COUNT)),  # no rate at all
        late(TRUE[kept(0.02)], 0.15)[:60],  # too short to tell
    ],
)
def test_other_times_are_left_alone(stamps: FloatArray):
    """Assert that only late stamps with lost samples between are replaced."""
    assert even_with_losses(stamps) is None


@pytest.mark.parametrize("jitter", [0.05, 0.15])
def test_a_log_with_late_stamps_and_lost_samples(jitter: float):
    """Assert that sample time and positions are right, and that the lost samples are counted."""
    left = kept(0.02)
    found = {name: values[left] for name, values in COLUMNS.items()}
    log = read_columns(found | {"time": late(TRUE[left], jitter)})
    (recording,) = log.recordings
    assert recording.sample_time == pytest.approx(STEP, rel=1e-5)
    assert len(recording) == COUNT
    off = recording.motor_position - COLUMNS["motor_position"]
    assert np.abs(off).max() < 1e-6
    assert any(f"{COUNT - len(left)} samples are missing" in text for text in log.warnings)
    assert any("smoother at even times with lost samples" in text for text in log.warnings)


def test_uneven_samples_keep_their_stamps():
    """Assert that samples that were taken at uneven times are not moved to even ones."""
    left = kept(0.02)
    times = late(TRUE[left], 0.15)
    positions = {name: np.interp(times, TRUE, values) for name, values in COLUMNS.items()}
    log = read_columns(positions | {"time": times})
    assert any("were interpolated to even times" in text for text in log.warnings)
    assert not any("with lost samples" in text for text in log.warnings)


def test_a_clock_that_leaps_loses_no_samples():
    """Assert even times where stamps leap by whole steps, and positions show no lost samples."""
    leaps = np.bincount(np.arange(60, COUNT, 97), minlength=COUNT)
    log = read_columns(COLUMNS | {"time": late(TRUE + STEP * np.cumsum(leaps), 0.2)})
    (recording,) = log.recordings
    np.testing.assert_array_equal(recording.motor_position, COLUMNS["motor_position"])
    assert any("smoother at even times, so these" in text for text in log.warnings)
    assert not any("rounded" in text for text in log.warnings)


def test_a_few_samples_between_two_pauses():
    """Assert that three samples between pauses, too few for a cubic, are no evidence of a time."""
    left = np.setdiff1d(kept(0.02), np.r_[1980:2000, 2003:2023])
    assert np.isin([2000, 2001, 2002], left).all()
    found = {name: values[left] for name, values in COLUMNS.items()}
    log = read_columns(found | {"time": late(TRUE[left], 0.1)})
    assert len(log.recordings) == 2
    assert any("smoother at even times with lost samples" in text for text in log.warnings)
