"""Stretches in which a logger or one sensor repeats its last sample, in mid-motion."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexid.recording.caution import Caution, Rank
from flexid.recording.names import first_times
from flexid.recording.velocities import position_noise

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from flexid.arrays import FloatArray
    from flexid.recording.channel import Channel

_POSITIONS = ("link_position", "motor_position", "deflection")
_FEWEST = 20  # samples without any change, to count
_SHARE = 0.02  # of the log, the same where no jump follows
_JUST_BEFORE = 5  # samples whose motion is compared with that of as many before them
_CLEAR = 20.0  # times a position's noise, by which it has to move in these
_FAR = 0.1  # of its range, by which the other side moves, where no jump follows
_UNBRAKED = 0.7  # of the motion before: a side that brakes evenly makes a third of it
_JUMP = 3.0  # times the steps after it, by which the first one is larger where samples were lost
_TO_THE_END = (0.5, 3.0)  # of the mean motion in a sample: that of the very last, which is no jump

Stretch = tuple[int, int]  # first sample, and the one after the last


def without_frozen(
    file: str, channels: dict[str, Channel], time: Channel
) -> tuple[dict[str, Channel], Channel, tuple[str, ...]]:
    """Channels and time without samples that are repeated in mid-motion, and warnings.

    A joint that meets a stop or a brake may rest from one sample to the next, as its encoders see
    it. So a stretch is left out only where a position is another one when it goes on, or where the
    log ends in mid-motion; and where the input rests as well or the other side of the joint moves.
    What is left of the log has a gap there.
    """
    values = {name: channel.values for name, channel in channels.items()}
    kept = np.ones(len(time.values), dtype=np.bool_)
    warnings = []

    def warn(what: str, stretches: Sequence[Stretch], remedy: str) -> None:
        if stretches:
            at = [f"{time.values[a]:.6g} s to {time.values[b - 1]:.6g} s" for a, b in stretches]
            sentence = f"{file}: {what.format(first_times(at))}: {remedy}"
            warnings.append(Caution(sentence, Rank.DATA))

    with np.errstate(all="ignore"):  # of numbers that no check has refused yet
        sensors = {n: _Position.of(values[n]) for n in _POSITIONS if n in values}
        found = {"": list(_of_all([*values.values()], [*sensors.values()]))}
        found |= {name: list(_of_one(name, sensors)) for name in sensors}
    for name, stretches in found.items():
        what = (
            f"{channels[name].place}: {name} does not change from {{}}, while the other side "
            f"moves, as if the sensor was stuck"
            if name
            else "nothing changes from {}, though the joint was in mid-motion, as if the last "
            "sample had been repeated"
        )
        # One side that rests to the end of the log may have met a brake.
        lasting = [one for one in stretches if name and one[1] == len(kept)]
        cut = stretches[: len(stretches) - len(lasting)]
        for start, stop in cut:
            kept[start + 1 : stop] = False  # the first of the repeated samples was measured
        warn(what, cut, "that part was left out; check the sensor and the logger")
        warn(what, lasting, "check the sensor, or cut that part out")
    if kept.all():
        return channels, time, tuple(warnings)
    left = {name: replace(c, values=c.values[kept]) for name, c in channels.items()}
    return left, replace(time, values=time.values[kept]), tuple(warnings)


class _Position(NamedTuple):
    """A position, and by how much it has to move."""

    values: FloatArray
    clear: float

    @classmethod
    def of(cls, values: FloatArray) -> _Position:
        return cls(values, _CLEAR * position_noise(values))


def _of_all(channels: Sequence[FloatArray], positions: Sequence[_Position]) -> Iterator[Stretch]:
    """Stretches of whole samples that are repeated."""
    count = len(channels[0])
    for start, stop in _unchanging(channels):
        lost = stop == count or any(_jumps(one, stop - 1) for one in positions)
        # At the beginning, a logger writes zeros until the drive answers.
        moved = start == 0 or any(_unbraked(p, start) for p in positions)
        if lost and stop - start >= _SHARE * count and moved:
            yield start, stop


def _of_one(name: str, sensors: Mapping[str, _Position]) -> Iterator[Stretch]:
    """Stretches in which one sensor repeats itself while the other side moves."""
    others = [sensor for other, sensor in sensors.items() if other != name]
    position = sensors[name]
    count = len(position.values)
    if not others or not np.ptp(position.values):
        return
    for start, stop in _unchanging([position.values]):
        moves = others[0].values[start:stop]
        if np.ptp(moves) <= others[0].clear or len(np.unique(moves)) < _FEWEST // 2:
            continue
        far = np.ptp(moves) > _FAR * np.ptp(others[0].values)
        lasting = stop == count and stop - start >= _SHARE * count
        if _jumps(position, stop - 1) or (lasting and far):
            yield start, stop


def _unchanging(channels: Sequence[FloatArray]) -> Iterator[Stretch]:
    """Stretches of some length in which no channel changes."""
    changes = np.any([values[1:] != values[:-1] for values in channels], axis=0)
    edges = np.concatenate(([0], np.flatnonzero(changes) + 1, [len(changes) + 1]))
    for start, stop in pairwise(edges.tolist()):
        if stop - start >= _FEWEST:
            yield start, stop


def _jumps(position: _Position, last: int) -> bool:
    """Whether a position's step from a sample on is beyond its noise and all that follow it."""
    steps = np.abs(np.diff(position.values[last : last + 2 + _JUST_BEFORE]))
    return len(steps) > _JUST_BEFORE and bool(
        steps[0] > max(position.clear, _JUMP * steps[1:].max())
    )


def _unbraked(position: _Position, place: int) -> bool:
    """Whether a position moves on to a sample as it did before."""
    if place < 2 * _JUST_BEFORE:
        return False
    values = position.values
    last, middle, first = values[[place, place - _JUST_BEFORE, place - 2 * _JUST_BEFORE]]
    moved = last - middle
    if abs(moved) < max(position.clear, _UNBRAKED * abs(middle - first)):
        return False
    least, most = _TO_THE_END
    return bool(least <= (last - values[place - 1]) / (moved / _JUST_BEFORE) <= most)
