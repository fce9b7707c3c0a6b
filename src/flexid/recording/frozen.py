"""Stretches in which a logger repeated its last sample: the joint stops dead, in mid-motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from flexid.recording.velocities import position_noise

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from flexid.arrays import FloatArray
    from flexid.recording.channel import Channel

_POSITIONS = ("link_position", "motor_position", "deflection")
_FEWEST = 20  # samples without any change, to count
_SHARE = 0.02  # of the log, the same
_JUST_BEFORE = 5  # samples whose motion is compared with that of as many before them
_CLEAR = 20.0  # times a position's noise, by which it has to move in these
_UNBRAKED = 0.7  # of the motion before: a side that brakes evenly makes a third of it
_JUMP = 3.0  # times the steps after it, by which the first one is larger where samples were lost
_TO_THE_END = (0.5, 3.0)  # of the mean motion in a sample: that of the very last, which is no jump


def without_frozen(
    file: str, channels: dict[str, Channel], time: Channel
) -> tuple[dict[str, Channel], Channel, tuple[str, ...]]:
    """Leave out where a sample is repeated whole, positions and inputs, in mid-motion.

    A joint that meets a stop or a brake may rest from one sample to the next, as its encoders see
    it. So nothing is left out but where the input rests as well, and in mid-log where the position
    is another one when it goes on. What is left of the log has a gap there.

    Parameters
    ----------
    file : str
        For messages.
    channels : dict of str to Channel
        By canonical name.
    time : Channel
        Increasing, in s.

    Returns
    -------
    channels : dict of str to Channel
    time : Channel
    warnings : tuple of str
    """
    with np.errstate(all="ignore"):  # of numbers that no check has refused yet
        found = list(_frozen({name: channel.values for name, channel in channels.items()}))
    if not found:
        return channels, time, ()
    kept = np.ones(len(time.values), dtype=np.bool_)
    for start, stop in found:
        kept[start + 1 : stop] = False  # the first of the repeated samples was measured
    at = [f"{time.values[a]:.6g} s to {time.values[b - 1]:.6g} s" for a, b in found]
    times = ", ".join(at[:3]) + (f" and {len(at) - 3} more times" if len(at) > 3 else "")
    warning = (
        f"{file}: nothing changes from {times}, though the joint was in mid-motion, as if the "
        f"last sample had been repeated: that part was left out; check the logger"
    )
    cut = {name: replace(c, values=c.values[kept]) for name, c in channels.items()}
    return cut, replace(time, values=time.values[kept]), (warning,)


def _frozen(channels: Mapping[str, FloatArray]) -> Iterator[tuple[int, int]]:
    """First sample of each such stretch, and the one after its last."""
    positions = [channels[name] for name in _POSITIONS if name in channels]
    count = len(positions[0])
    changes = np.any([values[1:] != values[:-1] for values in channels.values()], axis=0)
    edges = np.concatenate(([0], np.flatnonzero(changes) + 1, [count]))
    before = 2 * _JUST_BEFORE
    for start, stop in pairwise(edges.tolist()):
        if stop - start < max(_FEWEST, _SHARE * count) or start < before:
            continue
        goes_on = stop < count - _JUST_BEFORE
        lost = goes_on and any(_jumps(values[stop - 1 :]) for values in positions)
        if (lost or stop == count) and any(_unbraked(values[: start + 1]) for values in positions):
            yield start, stop


def _jumps(position: FloatArray) -> bool:
    """Whether a position's first step is beyond its noise and all that follow it."""
    steps = np.abs(np.diff(position[: 2 + _JUST_BEFORE]))
    return bool(steps[0] > max(_CLEAR * position_noise(position), _JUMP * steps[1:].max()))


def _unbraked(position: FloatArray) -> bool:
    """Whether a position moves on to its last sample as it did before."""
    last, middle, first = position[[-1, -1 - _JUST_BEFORE, -1 - 2 * _JUST_BEFORE]]
    moved = last - middle
    if abs(moved) < max(_CLEAR * position_noise(position), _UNBRAKED * abs(middle - first)):
        return False
    least, most = _TO_THE_END
    return bool(least <= (last - position[-2]) / (moved / _JUST_BEFORE) <= most)
