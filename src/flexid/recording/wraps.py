"""Wraps of encoders and clocks: undone where they are clear, named where they are not."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.names import MOST_TIMES, first_times
from flexid.recording.sampling import GAP

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexid.arrays import FloatArray
    from flexid.recording.channel import Channel

TURN = 2.0 * np.pi  # rad
_FEW_VALUES = 20  # a position of so few counts does not jump, it steps


def unwrap(file: str, name: str, channel: Channel, time: FloatArray) -> tuple[Channel, str]:
    """A position without jumps by a turn, and a warning; raise where it jumps by anything else."""
    values, steps, clock = channel.values, np.diff(channel.values), np.diff(time)
    turn = TURN / abs(channel.origin.gear_ratio) if channel.origin.gear_ratio else 0.0
    if np.abs(steps).max() <= 0.5 * (turn or TURN):
        return channel, ""
    positions, period = without_wraps(time, values, turn)
    period = period or TURN
    # A position may be another after a gap: there only a turn of the link's side is a wrap.
    seen = (clock <= GAP * np.median(clock)) | (period == TURN)
    jumps = np.flatnonzero(seen & (np.abs(steps) > 0.5 * period))
    if not len(jumps) or (period == TURN and len(jumps) > len(steps) // 4):
        return channel, ""  # a wrong unit makes so many, which `check_speed` finds
    if np.abs(np.diff(positions)[seen]).max() > 0.25 * period:
        raise RecordingError(
            file,
            channel.place,
            f"{name} jumps by {abs(steps[jumps[0]]):.3g} rad at {_times(time, jumps)}, which is "
            f"not a whole turn of an encoder: check the unit and the gear ratio, or remove the "
            f"outlier"
            + ("" if period == TURN else "; if the encoder wraps, unwrap it, or log faster"),
        )
    at = _times(time, jumps)
    warning = (
        f"{file}: {channel.place}: {name} jumps by a turn at {at}, and was unwrapped: check it"
    )
    return replace(channel, values=positions), warning


def without_wraps(time: FloatArray, readings: FloatArray, turn: float) -> tuple[FloatArray, float]:
    """Positions of a whole log's encoder, and what it wraps by in front of a gear, or 0.

    A turn of the motor is `turn` in rad at the link's side; 0 where the encoder stands there.
    """
    from flexid.kernels.store import load_kernel  # few logs wrap

    kernel = load_kernel("encoder_turns", (), None, ["encoder_turns"])
    gear, positions = kernel.first_gear(), np.empty(len(readings))
    sample_time = float(np.median(np.diff(time)))
    kernel.unwrapped_log(time, readings, turn, sample_time, gear, positions)
    if gear[kernel.PERIOD] < 0.0:  # what looked like a wrap was none
        return without_wraps(time, readings, 0.0)
    return positions, float(gear[kernel.PERIOD])


def _times(time: FloatArray, jumps: NDArray[np.intp]) -> str:
    return first_times([f"{time[index + 1]:.6g} s" for index in jumps[:MOST_TIMES]], len(jumps))


def count_on(file: str, time: Channel) -> tuple[Channel, tuple[str, ...]]:
    """A time that goes on where a counter of 16 or 32 bits begins again, and a warning of that."""
    if np.all(np.diff(time.values) >= 0.0):
        return time, ()
    ticks = time.values / time.origin.factor
    steps = np.diff(ticks)
    usual, again = np.median(steps), np.flatnonzero(steps < 0.0)
    for bits in (16, 32):
        if np.all(np.abs(steps[again] + 2.0**bits - usual) < (GAP - 1.0) * usual):
            at = first_times([f"{time.values[place]:.6g} s" for place in again])
            warning = (
                f"{file}: {time.place}: the time begins again after {at}, as a counter of {bits} "
                f"bits does, and was counted on: check it"
            )
            ticks[1:] += 2.0**bits * np.cumsum(steps < 0.0)
            return replace(time, values=ticks * time.origin.factor), (warning,)
    return time, ()


def turns_apart(position: FloatArray, other: FloatArray) -> float:
    """Whole turns in rad that one side is behind the other: where encoders began is not known."""
    return TURN * float(np.rint(np.median(other - position) / TURN))


def check_jumps(file: str, name: str, channel: Channel, time: FloatArray) -> tuple[str, ...]:
    """Warn of a position that jumps across its range, as a counter does that overflows.

    Its whole turn is not known, or it would have been unwrapped. A position may be another after a
    gap, and one of a few counts does not jump.
    """
    values, clock = channel.values, np.diff(time)
    steps = np.where(clock > GAP * np.median(clock), 0.0, np.abs(np.diff(values)))
    extent = float(np.ptp(values))
    is_jump = steps > 0.5 * extent
    if (
        not is_jump.any()
        or steps[~is_jump].max(initial=0.0) > 0.25 * extent
        or len(np.unique(values)) <= _FEW_VALUES
    ):
        return ()
    return (
        f"{file}: {channel.place}: {name} jumps by more than half of its range at "
        f"{_times(time, np.flatnonzero(is_jump))}: if a counter overflows, unwrap it, or write the "
        f"gear_ratio in a column map; if it is an outlier, remove it",
    )
