"""Resampling of signals with separate time stamps to common times."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording.names import quoted
from flexid.recording.sampling import EVEN, are_gaps, interpolated, parts_between

_SAME_RATE = 1.1  # ratio of rates that count as equal: each clock may drop some samples
_CUTOFF = 0.8  # cut-off frequency of the filter over half the slower rate
_HALF_LENGTH = 4.0  # half the length of the filter, in samples of the slower clock
_LARGEST = 1e100  # largest value that can be interpolated
_WRAP = 0.5  # of a position's range: a larger step is a wrap of the encoder


class Signal(NamedTuple):
    """Signal with the name of its clock."""

    header: str
    clock: str
    values: FloatArray
    held: bool  # whether it may change in steps, as an input


def on_one_clock(
    file: str, clocks: Mapping[str, FloatArray], signals: Sequence[Signal]
) -> tuple[FloatArray, dict[str, FloatArray], tuple[str, ...]]:
    """Interpolate signals to the times of the slowest clock, or the first of several.

    An input with a higher rate is low-pass filtered first, without delay: its mean over a sampling
    interval moves the drive, which single samples do not show. Positions are not filtered, so that
    their noise remains white. Where another clock has a gap, the log has one too.
    Return times in s, columns by header, and warnings.
    """
    for name, stamps in clocks.items():
        _check_stamps(file, name, stamps)
    for signal in signals:
        largest = float(np.abs(signal.values).max())
        if largest > _LARGEST:
            raise RecordingError(
                file, f"{signal.header!r}", f"it reaches {largest:.3g}: correct the value"
            )
    # The median step, because pauses of a clock do not lower its rate.
    rates = {name: 1.0 / float(np.median(np.diff(t))) for name, t in clocks.items()}
    slowest = min(rates.values())
    chosen = next(name for name, rate in rates.items() if rate <= _SAME_RATE * slowest)
    times = clocks[chosen]
    usable = np.ones(len(times), dtype=bool)
    rounding = EVEN * np.median(np.diff(times))
    separate = {
        name: t
        for name, t in clocks.items()
        if len(t) != len(times) or np.abs(t - times).max() > rounding
    }
    for stamps in separate.values():
        usable &= _between_samples(stamps, times)
    if usable.sum() < 2:
        reason = f"{quoted(clocks)} have no times in common: log them together, by one clock"
        raise RecordingError(file, "", reason)
    columns = {}
    filtered = []
    for signal in signals:
        if signal.clock not in separate:
            columns[signal.header] = signal.values[usable]
            continue
        _check_wraps(file, signal, chosen)
        ratio = rates[signal.clock] / rates[chosen]
        if signal.held and ratio > _SAME_RATE:
            filtered.append(signal.header)
            signal = signal._replace(values=_low_passed(clocks[signal.clock], signal.values, ratio))
        stamps = clocks[signal.clock]
        columns[signal.header] = interpolated(
            stamps, signal.values, times[usable], held=signal.held
        )
    moved = [signal.header for signal in signals if signal.clock in separate]
    warnings = (
        f"{file}: {quoted(moved)} had time stamps of their own and were interpolated to those of "
        f"{chosen!r}: log all channels together",
        f"{file}: {quoted(filtered)} was low-pass filtered to the rate of {chosen!r}: log all "
        f"channels at the faster rate",
    )
    return times[usable], columns, warnings[: bool(moved) + bool(filtered)]


def _low_passed(stamps: FloatArray, values: FloatArray, ratio: float) -> FloatArray:
    """Input low-pass filtered for a clock that is slower by `ratio`, separately between gaps."""
    from scipy.signal import firwin, oaconvolve

    half = ceil(round(_HALF_LENGTH * ratio, 6))  # rounded, since rates have rounding errors
    weights = firwin(2 * half + 1, _CUTOFF / ratio)
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
    """Mask of the times that lie between two samples of a clock without a gap."""
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
            f"it jumps, like an absolute encoder that wraps, and cannot be interpolated to the "
            f"times of {chosen!r}: unwrap it, or log the two together",
        )
