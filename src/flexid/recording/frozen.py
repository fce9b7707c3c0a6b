"""Stretches in which a logger or one sensor repeats its last sample, in mid-motion."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.caution import Rank
from flexid.recording.draft import POSITIONS, Draft
from flexid.recording.names import first_times
from flexid.recording.velocities import position_noise

_FEWEST = 20  # samples without any change, to count
_SHARE = 0.02  # of the log, the same where no jump follows
_JUST_BEFORE = 5  # samples whose motion is compared with that of as many before them
_CLEAR = 20.0  # times a position's noise, by which it has to move in these
_FAR = 0.1  # of its range, by which the other side moves, where no jump follows
_UNBRAKED = 0.7  # of the motion before: a side that brakes evenly makes a third of it
_JUMP = 3.0  # times the steps after it, by which the first one is larger where samples were lost
_TO_THE_END = (0.5, 3.0)  # of the mean motion in a sample: that of the very last, which is no jump
_STUCK = "{name} does not change from {at}, while the other side moves, as if the sensor was stuck"
_REPEATED = (
    "nothing changes from {at}, though the joint was in mid-motion, as if the last sample had been "
    "repeated"
)

Stretch = tuple[int, int]  # first sample, and the one after the last


def drop_frozen(log: Draft) -> None:
    """Leave out samples that are repeated in mid-motion, so that the log has a gap there.

    A joint that meets a stop or a brake may rest from one sample to the next, as its encoders see
    it. So a stretch is left out only where a position is another one when it goes on, or where the
    log ends in mid-motion; and where the input rests as well or the other side of the joint moves.
    """
    kept = np.ones(len(log.time.values), dtype=np.bool_)
    with np.errstate(all="ignore"):  # of numbers that no check has refused yet
        sensors = {
            name: _Position(log[name], _CLEAR * position_noise(log[name]))
            for name in log.those_of(POSITIONS)
        }
        every = [channel.values for channel in log.channels.values()]
        found = {"": list(_of_all(every, [*sensors.values()]))}
        found |= {name: list(_of_one(name, sensors)) for name in sensors}
    for name, stretches in found.items():
        # One side that rests to the end of the log may have met a brake.
        lasting = [one for one in stretches if name and one[1] == len(kept)]
        cut = stretches[: len(stretches) - len(lasting)]
        for start, stop in cut:
            kept[start + 1 : stop] = False  # the first of the repeated samples was measured
        _warn(log, name, cut, "that part was left out; check the sensor and the logger")
        _warn(log, name, lasting, "check the sensor, or cut that part out")
    if not kept.all():
        log.keep(kept)


def _warn(log: Draft, name: str, stretches: Sequence[Stretch], remedy: str) -> None:
    """Name the stretches in which a sensor is stuck, or all are."""
    time = log.time.values
    at = first_times([f"{time[a]:.6g} s to {time[b - 1]:.6g} s" for a, b in stretches])
    what = (_STUCK if name else _REPEATED).format(name=name, at=at)
    if stretches:
        place = log.channels[name].place if name else ""
        log.warn(place, f"{what}: {remedy}", Rank.DATA)


class _Position(NamedTuple):
    """A position, and by how much it has to move."""

    values: FloatArray
    clear: float


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
