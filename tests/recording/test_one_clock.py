"""Signals with different clocks, channels delayed by parts of a sample, and late stamps."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from joint_log import joint_columns, read_columns, without

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.estimators.channel_timing import invalid_ends, later, rate_of_later
from flexid.recording.late_stamps import even_with_losses
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


CLOCKS = {
    "no times in common": (TIMES + 5.0, TIMES),
    "a clock that runs back": (TIMES[::-1], TIMES),
    "times that repeat": (np.repeat(TIMES, 2)[:100], TIMES),
    "one sample": (TIMES[:1], TIMES[:1]),
    "a huge value": (1.1 * TIMES, 1e200 * TIMES),
    "an encoder that wraps": (1.1 * TIMES, np.mod(9.0 * TIMES, 6.28)),
}


def test_clocks_that_cannot_be_used(refusals: Any):
    """Assert that decreasing or disjoint clocks are named, and an encoder that wraps."""
    refusals({name: partial(joined, *clock) for name, clock in CLOCKS.items()})


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


SAMPLE_TIME = 1e-3
TIME = SAMPLE_TIME * np.arange(3000)
SHIFTS = [0.5, -0.5, 0.01, -0.75, 2.3, -7.49, 3.0, -4.0, 0.0]


def motion(time):
    """Return a motion of 20 and 61 rad/s about a constant."""
    return 2.0 + np.sin(20.0 * time) + 0.3 * np.cos(61.0 * time)


@pytest.mark.parametrize("samples", SHIFTS)
def test_motion_is_shifted_by_just_so_much(samples):
    """Assert that a motion of up to 10 Hz is shifted exactly, within the stated margins."""
    first, last = invalid_ends(samples)
    shifted = later(motion(TIME), samples)[first : len(TIME) - last]
    expected = motion(TIME - SAMPLE_TIME * samples)[first : len(TIME) - last]
    assert np.max(np.abs(shifted - expected)) < 1e-6
    assert first + last <= abs(samples) + 65
    if samples == int(samples):
        assert first + last == abs(samples)


@pytest.mark.parametrize("samples", SHIFTS)
def test_white_noise_stays_white(samples):
    """Assert that shifted white noise stays white, with the same variance."""
    noise = np.random.default_rng(1).standard_normal(100_000)
    shifted = later(noise, samples)[100:-100]
    correlation = [np.mean(shifted[lag:] * shifted[: len(shifted) - lag]) for lag in (0, 1, 2, 3)]
    assert correlation == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=0.02)


@pytest.mark.parametrize("samples", [0.5, -1.5, 0.0, 2.2])
def test_it_depends_smoothly_on_the_shift(samples):
    """Assert that the rate equals the derivative by the shift, also at half a sample.

    With a filter that switches there, fits stuck at half a sample and did not converge.
    """
    noisy = motion(TIME) + 0.1 * np.random.default_rng(2).standard_normal(len(TIME))
    step = 1e-4
    apart = later(noisy, samples + step) - later(noisy, samples - step)
    rate = rate_of_later(noisy, samples)
    assert rate == pytest.approx(apart / (2.0 * step), abs=1e-6)
    assert np.ptp(rate) > 0.1


@pytest.mark.parametrize("length", [1, 2, 3, 10, 997])
def test_a_line_of_any_length_stays_one(length):
    """Assert that a straight line is shifted exactly, up to its ends."""
    places = np.arange(length, dtype=np.float64)
    wanted = 3.0 - 0.5 * (places - 0.3) if length > 1 else [3.0]
    assert later(3.0 - 0.5 * places, 0.3) == pytest.approx(wanted)
    assert rate_of_later(3.0 - 0.5 * places, 0.3) == pytest.approx(0.5 if length > 1 else 0.0)


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
