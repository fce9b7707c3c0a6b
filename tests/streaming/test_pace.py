"""When the samples of a log that is played again are due."""

import numpy as np
import pytest

from flexid.streaming.incoming import LONGEST_WAIT, Pace

H = 0.01
TIMES = 5.0 + H * np.arange(1000)
PLACES = np.arange(1000) >= 400


def due(times: np.ndarray, cut: int = 1000) -> tuple[np.ndarray, int]:
    """Due times, from two blocks, and how many jumps were counted."""
    pace = Pace()
    parts = [part for part in np.split(times, [cut]) if len(part)]
    return np.concatenate([pace.due(part) for part in parts]), pace.jumps


@pytest.mark.parametrize("cut", [1000, 399, 400, 401])
@pytest.mark.parametrize("ahead", [3600.0, 1e308])
def test_one_stamp_in_the_future(cut: int, ahead: float):
    """Assert that it is waited for a second once, however the samples are cut into blocks."""
    times = TIMES.copy()
    times[400] += ahead
    found, jumps = due(times, cut)
    assert jumps == 1
    right = TIMES - TIMES[0] + np.where(PLACES, LONGEST_WAIT, 0.0)
    np.testing.assert_allclose(found, right, atol=3 * H)


@pytest.mark.parametrize("cut", [1000, 400])
@pytest.mark.parametrize(("by", "wait"), [(3600.0, LONGEST_WAIT), (-3.0, 0.0), (0.9, 0.9)])
def test_a_clock_that_goes_on_elsewhere(cut: int, by: float, wait: float):
    """Assert that a pause is cut short, and a clock that is set back holds nobody up."""
    found, jumps = due(np.where(PLACES, TIMES + by, TIMES), cut)
    assert jumps == (by > LONGEST_WAIT)
    right = TIMES - TIMES[0] + np.where(PLACES, wait - H * (wait != 0.9), 0.0)
    np.testing.assert_allclose(found, right, atol=2 * H)


def test_late_samples_come_with_those_before_them():
    """Assert that no delay is waited for twice."""
    times = TIMES.copy()
    times[300:305] -= 0.5
    found, jumps = due(times)
    assert jumps == 0
    np.testing.assert_allclose(found, np.maximum.accumulate(times) - TIMES[0], atol=1e-9)


def test_a_clock_that_returns_after_long():
    """Assert that what it says then again comes at its own pace, not all at once."""
    times = np.concatenate((TIMES, 60.0 + TIMES, TIMES[-1] + TIMES - TIMES[0]))
    found, jumps = due(times)
    assert jumps == 1
    assert found[-1] == pytest.approx(3 * 1000 * H + LONGEST_WAIT, abs=4 * H)
