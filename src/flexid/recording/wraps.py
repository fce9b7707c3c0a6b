"""Wraps of absolute encoders: undone where they are clear, named where they are not."""

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


def unwrapped(
    file: str, name: str, channel: Channel, time: FloatArray
) -> tuple[FloatArray, NDArray[np.intp]]:
    """A position without jumps by a turn, and the samples before the jumps.

    Raises
    ------
    RecordingError
        If it jumps, but not clearly by whole turns.
    """
    values = channel.values
    steps, clock = np.diff(values), np.diff(time)
    # A position may be another after a gap: there only a turn of the link's side is a wrap.
    within = clock <= GAP * np.median(clock) if len(clock) else np.zeros(0, dtype=bool)
    turn = _turn(channel, steps[within])
    seen = within | (turn == TURN)
    is_jump = (np.abs(steps) > turn / 2) & seen
    jumps = np.flatnonzero(is_jump)
    if turn == TURN and len(jumps) > len(steps) // 4:  # a wrong unit, which `check_speed` finds
        return values, jumps[:0]
    if not len(jumps):
        return values, jumps
    turns = np.rint(steps[jumps] / turn)
    left_over = np.abs(steps[jumps] - turn * turns).max()
    others = np.abs(steps[~is_jump & seen]).max(initial=0.0)
    if max(left_over, others) > turn / 4:
        raise RecordingError(
            file,
            channel.place,
            f"{name} jumps by {abs(steps[jumps[0]]):.3g} rad at {_times(time, jumps)}, which is "
            f"not a whole turn of an encoder: check the unit and the gear ratio, or remove the "
            f"outlier"
            + ("" if turn == TURN else "; if the encoder wraps, unwrap it, or log faster"),
        )
    corrections = np.zeros_like(steps)
    corrections[jumps] = turn * turns
    return values - np.concatenate(([0.0], np.cumsum(corrections))), jumps


def unwrap(file: str, name: str, channel: Channel, time: FloatArray) -> tuple[Channel, str]:
    """A position without jumps by a turn, and a warning, empty where there was none."""
    values, jumps = unwrapped(file, name, channel, time)
    if not len(jumps):
        return channel, ""
    return replace(channel, values=values), _warning(file, name, channel.place, _times(time, jumps))


def _warning(file: str, name: str, place: str, times: str) -> str:
    return f"{file}: {place}: {name} jumps by a turn at {times}, and was unwrapped: check it"


def _times(time: FloatArray, jumps: NDArray[np.intp]) -> str:
    return first_times([f"{time[index + 1]:.6g} s" for index in jumps[:MOST_TIMES]], len(jumps))


def _turn(channel: Channel, steps: FloatArray) -> float:
    """What an encoder wraps by, in rad at the link's side of the gear.

    Behind a gear that is a turn of the motor, or the whole turns that a counter holds, where the
    position jumps by them and stays within them. A log that is sampled so slowly that the motor
    makes half a turn between two samples does not.
    """
    gear = channel.origin.gear_ratio
    if not gear or not len(steps):
        return TURN
    turn = TURN / abs(gear)
    turns = round(float(np.abs(steps).max()) / turn)
    wraps = turns >= 1 and float(np.ptp(channel.values)) < (turns + 0.01) * turn
    return turns * turn if wraps else TURN


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
