"""Signals with time stamps of their own, brought to common times."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording.names import quoted
from flexid.recording.sampling import EVEN, are_gaps, interpolated, parts_between

_SAME_RATE = 1.1  # rates that differ by less are one: each clock drops some samples
_PASSED = 0.8  # of half the slower rate, up to which an input passes
_LENGTH = 4.0  # samples of the slower clock to either side that the filter spans
_LARGEST = 1e100  # of a value that can be interpolated
_WRAP = 0.5  # of a position's range, which no position moves within one sample


class Signal(NamedTuple):
    """A signal and its clock."""

    header: str
    clock: str
    values: FloatArray
    held: bool  # whether it may step, as an input does


def on_one_clock(
    file: str, clocks: Mapping[str, FloatArray], signals: Sequence[Signal]
) -> tuple[FloatArray, dict[str, FloatArray], tuple[str, ...]]:
    """Bring signals to the times of the slowest, of several the first clock.

    Of an input that comes more often, what is too fast for the slower clock is filtered out before,
    without a delay: it moves the drive by its mean, which single samples of it do not show.
    Positions are not filtered: their noise is to stay white. Where another clock has a gap, the log
    gets one, too. Returned are times in s, columns by header, and warnings.
    """
    for name, stamps in clocks.items():
        _check_stamps(file, name, stamps)
    for signal in signals:
        largest = float(np.abs(signal.values).max())
        if largest > _LARGEST:
            raise RecordingError(
                file, f"{signal.header!r}", f"it reaches {largest:.3g}: correct the value"
            )
    # Of the samples where there are some: a clock that paused is no slower for that.
    rates = {name: 1.0 / float(np.median(np.diff(t))) for name, t in clocks.items()}
    slowest = min(rates.values())
    chosen = next(name for name, rate in rates.items() if rate <= _SAME_RATE * slowest)
    times = clocks[chosen]
    usable = np.ones(len(times), dtype=bool)
    rounding = EVEN * np.median(np.diff(times))
    apart = {
        name: t
        for name, t in clocks.items()
        if len(t) != len(times) or np.abs(t - times).max() > rounding
    }
    for stamps in apart.values():
        usable &= _between_samples(stamps, times)
    if usable.sum() < 2:
        reason = f"{quoted(clocks)} have no times in common: log them together, by one clock"
        raise RecordingError(file, "", reason)
    columns = {}
    filtered = []
    for signal in signals:
        if signal.clock not in apart:
            columns[signal.header] = signal.values[usable]
            continue
        _check_wraps(file, signal, chosen)
        ratio = rates[signal.clock] / rates[chosen]
        if signal.held and ratio > _SAME_RATE:
            filtered.append(signal.header)
            signal = signal._replace(values=_slow(clocks[signal.clock], signal.values, ratio))
        stamps = clocks[signal.clock]
        columns[signal.header] = interpolated(
            stamps, signal.values, times[usable], held=signal.held
        )
    moved = [signal.header for signal in signals if signal.clock in apart]
    warnings = (
        f"{file}: {quoted(moved)} had time stamps of their own and were interpolated to those of "
        f"{chosen!r}: log all channels together",
        f"{file}: of {quoted(filtered)} what is too fast for {chosen!r} was filtered out: log all "
        f"channels at the faster rate",
    )
    return times[usable], columns, warnings[: bool(moved) + bool(filtered)]


def _slow(stamps: FloatArray, values: FloatArray, ratio: float) -> FloatArray:
    """What a clock slower by some ratio can show of an input, part by part between gaps."""
    from scipy.signal import firwin, oaconvolve

    half = ceil(round(_LENGTH * ratio, 6))  # a rate is known but for rounding
    weights = firwin(2 * half + 1, _PASSED / ratio)
    slow = np.empty(len(values))
    for part in parts_between(are_gaps(stamps)):
        longer = np.pad(values[part], half, mode="reflect", reflect_type="odd")
        slow[part] = oaconvolve(longer, weights, mode="valid")
    return slow


def _check_stamps(file: str, clock: str, stamps: FloatArray) -> None:
    if len(stamps) < 2:
        raise RecordingError(
            file, f"{clock!r}", f"it has {len(stamps)} samples: log it as often as the others"
        )
    steps = np.diff(stamps)
    if not steps.min() > 0.0:
        index = int(np.argmax(~(steps > 0.0)))
        raise RecordingError(
            file,
            f"row {index + 2} of {clock!r}",
            f"time runs backwards or repeats (from {stamps[index]:.9g} s to "
            f"{stamps[index + 1]:.9g} s): remove what was logged twice",
        )


def _between_samples(stamps: FloatArray, times: FloatArray) -> np.ndarray:
    """Which times lie between two samples that follow each other without a gap."""
    after = np.searchsorted(stamps, times)
    inside = (times >= stamps[0]) & (times <= stamps[-1])
    after = np.clip(after, 1, len(stamps) - 1)
    return inside & ~are_gaps(stamps)[after - 1]


def _check_wraps(file: str, signal: Signal, chosen: str) -> None:
    jumps = np.abs(np.diff(signal.values))
    if signal.held or not jumps.max():
        return
    if jumps.max() > _WRAP * np.ptp(signal.values):
        raise RecordingError(
            file,
            f"{signal.header!r}",
            f"it jumps, as an absolute encoder does that wraps, and cannot be interpolated to the "
            f"times of {chosen!r}: unwrap it, or log the two together",
        )
