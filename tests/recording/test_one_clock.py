"""Signals with different clocks, resampled to one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from joint_log import refused

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording.one_clock import Signal, on_one_clock

TIMES = 0.01 * np.arange(100.0)


def joined(
    times: FloatArray, values: FloatArray, *, held: bool = False
) -> tuple[FloatArray, dict[str, FloatArray], tuple[str, ...]]:
    """Resample a signal to `TIMES`, the clock of another signal."""
    signals = [Signal("a", "slow", TIMES, False), Signal("b", "other", values, held)]
    return on_one_clock("log", {"slow": TIMES, "other": times}, signals)


def test_positions_are_kept_or_interpolated():
    """Assert no interpolation for times that differ by rounding, and else exact cubics."""
    values = np.random.default_rng(1).normal(size=100)
    times, columns, warnings = joined(TIMES + 1e-7, values)
    np.testing.assert_array_equal(columns["b"], values)
    np.testing.assert_array_equal(times, TIMES)
    assert not warnings
    fast = 0.0033 * np.arange(320.0)
    times, columns, warnings = joined(fast, fast**3 - fast)
    np.testing.assert_allclose(columns["b"], times**3 - times, atol=1e-12)
    assert "'b' had time stamps of their own" in warnings[0]


def test_inputs_keep_their_range_and_impulse():
    """Assert steps that stay in range, and the impulse of a torque that is sampled faster."""
    as_fast = 0.0095 * np.arange(110.0)
    _, columns, warnings = joined(as_fast, np.sign(np.sin(20.0 * as_fast) + 0.1), held=True)
    assert np.abs(columns["b"]).max() <= 1.0
    assert len(warnings) == 1
    fast = 0.001 * np.arange(1000.0)
    noise = np.random.default_rng(4).normal(size=len(fast))
    impulse = 0.001 * np.cumsum(noise)
    times, columns, warnings = joined(fast, noise, held=True)
    true = np.interp(times, fast + 0.001, impulse, left=0.0)

    def off(samples: FloatArray) -> float:
        steps = 0.01 * 0.5 * (samples[1:] + samples[:-1])
        return float(np.std(np.cumsum(steps) - (true[1:] - true[0])))

    assert off(columns["b"]) < 0.2 * off(np.interp(times, fast, noise))
    assert "'b' was low-pass filtered to the rate of 'slow'" in warnings[1]


@pytest.mark.parametrize(("rate", "gain"), [(30.0, 1.0), (100.0, 1.0), (600.0, 0.0)])
def test_what_the_slower_clock_can_show_passes_without_delay(rate: float, gain: float):
    """Assert that tones pass up to a third of the Nyquist frequency, and none above it."""
    fast = 0.001 * np.arange(1000.0)
    times, columns, _ = joined(fast, np.sin(rate * fast), held=True)
    middle = (times > 0.1) & (times < 0.9)
    np.testing.assert_allclose(columns["b"][middle], gain * np.sin(rate * times[middle]), atol=0.01)


def test_gaps_and_pauses_of_a_clock():
    """Assert no filter across a gap, no samples in another's gap, and the rate without a pause."""
    fast = 0.001 * np.arange(1000.0)
    kept = (fast < 0.4) | (fast > 0.6)
    times, columns, _ = joined(fast[kept], np.where(fast < 0.5, 1.0, -50.0)[kept], held=True)
    np.testing.assert_allclose(columns["b"], np.where(times < 0.5, 1.0, -50.0), rtol=1e-9)
    fast = 0.005 * np.arange(200.0)
    logged = fast[(fast < 0.3) | (fast > 0.6)]
    times, columns, _ = joined(logged, np.sin(logged))
    assert not ((times > 0.3) & (times < 0.6)).any()
    np.testing.assert_allclose(columns["b"], np.sin(times), atol=1e-9)
    assert set(times) == {t for t in TIMES if t <= 0.295 + 1e-12 or 0.605 - 1e-12 <= t <= fast[-1]}
    fast = np.concatenate((0.001 * np.arange(20.0), 0.97 + 0.001 * np.arange(15.0)))
    assert len(fast) < len(TIMES)
    times, _, warnings = joined(fast, np.zeros(len(fast)), held=True)
    assert {*times} <= {*TIMES}
    assert any("was low-pass filtered" in warning for warning in warnings)


def test_the_slower_clock_is_taken():
    """Assert that the slowest clock is taken, so that no samples are invented."""
    slow = 0.02 * np.arange(50.0)
    times, columns, warnings = joined(slow, slow)
    np.testing.assert_allclose(times, slow)
    np.testing.assert_allclose(columns["a"], slow, atol=1e-12)
    assert (
        "'a' had time stamps of their own and were interpolated to those of 'other'" in warnings[0]
    )


@pytest.mark.parametrize(
    ("times", "values", "words"),
    [
        (TIMES + 5.0, TIMES, "'slow', 'other' have no times in common"),
        (TIMES[::-1], TIMES, "row 2 of 'other': time runs backwards or repeats"),
        (np.repeat(TIMES, 2)[:100], TIMES, "row 2 of 'other': time runs backwards or repeats"),
        (TIMES[:1], TIMES[:1], "'other': it has 1 samples"),
        (1.1 * TIMES, 1e200 * TIMES, "'b': it reaches 9.9e+199: correct the value"),
        (1.1 * TIMES, np.mod(9.0 * TIMES, 6.28), "'b': it jumps, like an absolute encoder"),
    ],
)
def test_clocks_that_cannot_be_used(times: FloatArray, values: FloatArray, words: str):
    """Assert that decreasing or disjoint clocks are named, and an encoder that wraps."""
    assert words in refused(joined, times, values)


@given(st.data())
def test_any_clocks(data: st.DataObject):
    """Assert that any increasing clocks give common times and finite values, or a refusal."""
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
