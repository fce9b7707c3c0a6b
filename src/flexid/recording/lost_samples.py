"""Samples that were lost, whether the clock shows it or not: found, and put back.

Where the time was counted from the samples that are there, every position advances by one more step
than around it. A step is compared with the parabola through its neighbours, with and without
samples lost, by the likelihood of both for all positions together.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from flexid.recording.channel import Channel
from flexid.recording.sampling import MOST_GAPS, MOST_JITTER, interpolated

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from flexid.arrays import FloatArray

_AROUND = 4  # steps on either side
_MOST_LOST = 3  # samples in one place; a longer gap is a gap
_CLEAR = 8.0  # of the logarithm of the likelihoods' ratio: a chance of 1 in 3000, at a place in 100
_LEAST_SHARE = 4.0  # times as many places as there are where a step seems to be one too many
_PASSES = 3  # over the log: a place hides those beside it
FEWEST_PLACES = 3  # where samples are lost: fewer change next to nothing
_SHORTEST_PART = 2.0  # s between losses that the clock shows: a log of longer parts is cut instead
_EVEN = 1e-3  # of a step, by which a counted time differs from even


def lost_samples(positions: list[FloatArray], time: FloatArray) -> NDArray[np.int64]:
    """How many samples are lost after each, shape (n - 1,); all 0 where nothing shows it."""
    none = np.zeros(len(time) - 1, dtype=np.int64)
    if not positions or len(time) < 8 * _AROUND or not _is_counted(time):
        return none
    lost = none
    for _ in range(_PASSES):
        more, ratio = _likeliest(positions, lost)
        clear = (ratio > _CLEAR) & (lost == 0)
        added = np.where(clear & (more > 0), more, 0)
        # Where the motion itself makes steps uneven it stops as often as it doubles.
        if np.count_nonzero(added) < _LEAST_SHARE * np.count_nonzero(clear & (more < 0)):
            return none
        if not added.any():
            break
        lost = lost + added
    return lost


def lost_by_the_clock(time: FloatArray) -> NDArray[np.int64]:
    """How many samples are missing after each, shape (n - 1,), where they are few but often.

    A cut loses no accuracy, interpolation a little: but a log in pieces shows no slow motion.
    """
    steps = np.diff(time) / np.median(np.diff(time))
    whole = np.rint(steps)
    is_loss = (whole >= 2) & (whole <= _MOST_LOST + 1) & (np.abs(steps - whole) <= MOST_JITTER)
    lost = np.where(is_loss, whole - 1, 0).astype(np.int64)
    places = np.count_nonzero(lost)
    is_often = places >= FEWEST_PLACES and places * _SHORTEST_PART > time[-1] - time[0]
    return lost if is_often and np.mean(lost > 0) <= MOST_GAPS else np.zeros_like(lost)


def put_back(channel: Channel, lost: NDArray[np.int64], *, held: bool) -> Channel:
    """A channel with the lost samples interpolated; one that may step, without overshoot."""
    kept = _kept(lost)
    every = np.arange(kept[-1] + 1.0)
    values = interpolated(kept.astype(np.float64), channel.values, every, held=held)
    values[kept] = channel.values
    return replace(channel, values=values)


def stamped_on(time: FloatArray, lost: NDArray[np.int64]) -> FloatArray:
    """The time of all samples, those that are missing by the clock among them."""
    kept = _kept(lost)
    return np.interp(np.arange(kept[-1] + 1), kept, time)


def counted_on(time: FloatArray, lost: NDArray[np.int64]) -> FloatArray:
    """The time of all samples, those that the clock does not know of among them."""
    step = (time[-1] - time[0]) / (len(time) - 1)
    return time[0] + step * np.arange(len(time) + int(lost.sum()))


def _kept(lost: NDArray[np.int64]) -> NDArray[np.int64]:
    """Places of the samples that are there among all."""
    return np.concatenate(([0], np.cumsum(1 + lost)))


def _is_counted(time: FloatArray) -> bool:
    steps = np.diff(time)
    return bool(np.ptp(steps) <= _EVEN * np.median(steps))


def _likeliest(
    positions: list[FloatArray], lost: NDArray[np.int64]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Samples lost at each step, and how much more likely that is than none; -1: a step missing."""
    numbers = np.array([-1, *range(1, _MOST_LOST + 1)])
    ratios = np.zeros((len(numbers), len(lost)))
    for values in positions:
        usual, spread = _usual(np.diff(values), lost)
        more = np.diff(values) - usual
        plain = float(np.median(np.abs(more[np.isfinite(more)]))) / 0.6745
        variance = np.maximum(plain, spread) ** 2 + np.finfo(float).tiny
        for place, number in enumerate(numbers):
            ratios[place] += (more**2 - (more - number * usual) ** 2) / (2.0 * variance)
    ratios = np.where(np.isfinite(ratios), ratios, -np.inf)
    best = np.argmax(ratios, axis=0)
    return numbers[best], ratios[best, np.arange(len(lost))]


def _usual(steps: FloatArray, lost: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
    """The step that its neighbours speak for, and how far it may be off; NaN at the ends.

    A parabola through those that lost nothing, by least squares.
    """
    n = len(steps)
    offsets = np.array([k for k in range(-_AROUND, _AROUND + 1) if k])
    places = np.arange(_AROUND, n - _AROUND)[:, None] + offsets
    weights = (lost[places] == 0).astype(float)
    powers = np.stack([np.ones(len(offsets)), offsets, offsets**2], axis=1)
    normal = np.einsum("kj,ji,jl->kil", weights, powers, powers)
    right = np.einsum("kj,ji->ki", weights * steps[places], powers)
    enough = weights.sum(axis=1) > 5.0
    normal[~enough] = np.eye(3)
    inverse = np.linalg.inv(normal)
    found = np.einsum("kij,kj->ki", inverse, right)
    left = weights * (steps[places] - found @ powers.T)
    variance = np.sum(left**2, axis=1) / np.maximum(weights.sum(axis=1) - 3.0, 1.0)
    usual, spread = np.full(n, np.nan), np.full(n, np.nan)
    inside = slice(_AROUND, n - _AROUND)
    usual[inside] = np.where(enough, found[:, 0], np.nan)
    spread[inside] = np.sqrt(variance * (1.0 + inverse[:, 0, 0]))
    return usual, spread
