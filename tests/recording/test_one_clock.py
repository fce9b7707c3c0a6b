"""Signals with clocks of their own, brought to one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording.one_clock import Signal, on_one_clock

TIMES = 0.01 * np.arange(100.0)


def joined(
    times: FloatArray, values: FloatArray, *, held: bool = False
) -> tuple[FloatArray, dict[str, FloatArray], tuple[str, ...]]:
    """Bring a signal to `TIMES`, of which another signal has the clock."""
    signals = [Signal("a", "slow", TIMES, False), Signal("b", "other", values, held)]
    return on_one_clock("log", {"slow": TIMES, "other": times}, signals)


def test_the_same_clock():
    """Assert that time stamps that differ by rounding are one clock: nothing is interpolated."""
    values = np.random.default_rng(1).normal(size=100)
    times, columns, warnings = joined(TIMES + 1e-7, values)
    np.testing.assert_array_equal(columns["b"], values)
    np.testing.assert_array_equal(times, TIMES)
    assert not warnings


def test_cubics_are_kept():
    """Assert that a position which is a cubic of time is met exactly between its samples."""
    fast = 0.0033 * np.arange(320.0)
    times, columns, warnings = joined(fast, fast**3 - fast)
    np.testing.assert_allclose(columns["b"], times**3 - times, atol=1e-12)
    assert "'b' had time stamps of their own" in warnings[0]


def test_inputs_do_not_overshoot():
    """Assert that an input that steps stays between its values."""
    fast = 0.0033 * np.arange(320.0)
    _, columns, _ = joined(fast, np.sign(np.sin(20.0 * fast) + 0.1), held=True)
    assert np.abs(columns["b"]).max() <= 1.0


def test_a_gap_of_another_clock_is_one():
    """Assert that where another signal was not logged no sample is made up."""
    fast = 0.005 * np.arange(200.0)
    logged = fast[(fast < 0.3) | (fast > 0.6)]
    times, columns, _ = joined(logged, np.sin(logged))
    assert not ((times > 0.3) & (times < 0.6)).any()
    np.testing.assert_allclose(columns["b"], np.sin(times), atol=1e-9)
    assert set(times) == {t for t in TIMES if t <= 0.295 + 1e-12 or 0.605 - 1e-12 <= t <= fast[-1]}


def test_the_slower_clock_is_taken():
    """Assert that nothing is made of samples that are not there: the slowest clock is the log's."""
    slow = 0.02 * np.arange(50.0)
    times, columns, warnings = joined(slow, slow)
    np.testing.assert_allclose(times, slow)
    np.testing.assert_allclose(columns["a"], slow, atol=1e-12)
    assert (
        "'a' had time stamps of their own and were interpolated to those of 'other'" in warnings[0]
    )


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (TIMES + 5.0, "'slow', 'other' have no times in common"),
        (TIMES[::-1], "row 2 of 'other': time runs backwards or repeats"),
        (np.repeat(TIMES, 2)[:100], "row 2 of 'other': time runs backwards or repeats"),
        (TIMES[:1], "'other': it has 1 samples"),
    ],
)
def test_clocks_that_cannot_be_used(times: FloatArray, words: str):
    """Assert that clocks which do not run, or do not meet, are named."""
    with pytest.raises(RecordingError) as caught:
        joined(times, np.arange(float(len(times))))
    assert words in str(caught.value)


def test_a_position_that_wraps():
    """Assert that no curve is drawn through the jump of an absolute encoder."""
    fast = 0.003 * np.arange(330.0)
    with pytest.raises(RecordingError, match=r"'b': it jumps, as an absolute encoder"):
        joined(fast, np.mod(9.0 * fast, 2.0 * np.pi))


@settings(deadline=None, max_examples=100, derandomize=True)
@given(st.data())
def test_any_clocks(data: st.DataObject):
    """Assert that any increasing clocks give times within both and finite values, or none."""
    steps = st.lists(st.floats(1e-4, 0.1), min_size=2, max_size=60)
    clocks = {name: np.cumsum(data.draw(steps)) for name in ("slow", "other")}
    signals = [Signal(name, name, np.sin(times), False) for name, times in clocks.items()]
    try:
        times, columns, _ = on_one_clock("log", clocks, signals)
    except RecordingError:
        return
    assert (np.diff(times) > 0.0).all()
    for name, own in clocks.items():
        assert own[0] - 1e-9 <= times[0]
        assert times[-1] <= own[-1] + 1e-9
        assert np.isfinite(columns[name]).all()
        assert len(columns[name]) == len(times)
