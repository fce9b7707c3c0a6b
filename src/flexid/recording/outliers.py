"""Single samples that no motion explains: spikes of an encoder, and samples that are lost.

A sample is compared with the cubic through its four neighbours. What differs by much more than
noise while all around it is calm is no motion.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.recording.caution import Rank
from flexid.recording.channel import INPUTS
from flexid.recording.draft import POSITIONS, Draft
from flexid.recording.lost_samples import (
    FEWEST_PLACES,
    counted_anew,
    counted_on,
    lost_by_the_clock,
    lost_samples,
    put_back,
    stamped_on,
)
from flexid.recording.sampling import GAP, warn_rounded
from flexid.recording.velocities import position_noise

_OFF = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0  # what a cubic through the others leaves over
_SPIKE = 20.0  # times the noise, by which a spike is off: 14 standard deviations
_CALM = 0.4  # of a spike, up to which the motion around it bends; where it stops dead, more than 1
_AROUND = 8  # samples on either side
_MOST = 0.01  # share of spikes, up to which a channel is mended: more are no single errors


def mend(log: Draft) -> None:
    """Replace spikes of encoders, and put back lost samples."""
    if len(log.time.values) < 4 * _AROUND:
        return
    sensors = log.those_of(POSITIONS)
    with np.errstate(all="ignore"):  # of numbers that no check has refused yet
        for name in sensors:
            _mend_spikes(log, name)
        positions = [log[name] for name in sensors]
        counted = counted_anew(log.time.values, positions)
        if counted is not None:
            digit, step = np.median(np.diff(log.time.values)), np.min(np.diff(counted))
            warn_rounded(log, "the time", float(digit), float(step), Rank.DATA)
            log.set_time(counted)
        time = log.time.values
        lost = lost_samples(positions, time)
    missing = lost_by_the_clock(time)
    if missing.any():
        places = np.flatnonzero(missing)
        log.warn(
            "",
            f"{missing.sum()} samples are missing in {len(places)} places (after "
            f"{log.at(places)}), up to three in each, so they were put back by interpolation: "
            f"record without gaps",
            Rank.DATA,
        )
        _put_back(log, missing, stamped_on(time, missing))
    elif np.count_nonzero(lost) >= FEWEST_PLACES:
        places = np.flatnonzero(lost)
        log.warn(
            log.columns(sensors),
            f"in {len(places)} places all positions advance by whole steps more than around them "
            f"(at {log.at(places)}): {lost.sum()} samples were lost and the time counted from the "
            f"rest, so they were put back by interpolation: log the time of each sample",
            Rank.DATA,
        )
        log.uncounted = tuple(np.repeat(np.arange(len(lost)), lost).tolist())
        _put_back(log, lost, counted_on(time, lost, is_span=counted is not None))


def _put_back(log: Draft, lost: NDArray[np.int64], time: FloatArray) -> None:
    """Put lost samples back, at the times of all."""
    for name in log.channels:
        log[name] = put_back(log[name], lost, held=name in INPUTS)
    log.set_time(time)


def _mend_spikes(log: Draft, name: str) -> None:
    """Replace the spikes of a position, where they are few."""
    clock, values = np.diff(log.time.values), log[name].copy()
    found = list(_spikes(values, clock <= GAP * np.median(clock)))
    if not 0 < len(found) <= max(1.0, _MOST * len(values)):
        return
    places, sizes = map(np.array, zip(*found, strict=True))
    values[places] -= sizes
    log[name] = values
    single = "sample is" if len(found) == 1 else "samples are"
    log.warn(
        log.channels[name].place,
        f"{len(found)} {single} off the samples around by up to {np.abs(sizes).max():.2g} rad (at "
        f"{log.at(places)}), so a cubic through these was taken instead: check the sensor and its "
        f"cable",
        Rank.DATA,
    )


def _spikes(values: FloatArray, even: NDArray[np.bool_]) -> Iterator[tuple[int, float]]:
    """Place and size of each sample that is off alone."""
    off = np.zeros(len(values))
    off[2:-2] = np.convolve(values, _OFF, mode="valid")
    suspect = np.abs(off) > _SPIKE * position_noise(values)
    usual = values[~suspect]
    low, high = usual.min(initial=np.inf), usual.max(initial=-np.inf)
    middle = _AROUND - 1  # of the second differences, the sample's own
    for place in np.flatnonzero(suspect[_AROUND:-_AROUND]) + _AROUND:
        bends = np.diff(values[place - _AROUND : place + _AROUND + 1], 2)
        bends = (bends - np.median(bends)) / abs(off[place])
        # Of a spike they are as 1, -2, 1; of a velocity that jumps they have one sign.
        bends[middle - 1 : middle + 2] -= np.sign(off[place]) * np.array([1.0, -2.0, 1.0])
        if np.abs(bends).max() > _CALM or not even[place - 2 : place + 2].all():
            continue
        # A counter that overflows may flicker from one end of its range to the other.
        if low <= values[place] <= high and abs(off[place]) > 0.5 * (high - low):
            continue
        yield int(place), float(off[place])
