"""Single samples that no motion explains: spikes of an encoder, and samples that are lost.

A sample is compared with the cubic through its four neighbours. What differs by much more than
noise while all around it is calm is no motion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexid.recording.caution import Caution, Rank
from flexid.recording.channel import INPUTS
from flexid.recording.lost_samples import (
    FEWEST_PLACES,
    counted_anew,
    counted_on,
    lost_by_the_clock,
    lost_samples,
    put_back,
    stamped_on,
)
from flexid.recording.names import MOST_TIMES, first_times
from flexid.recording.sampling import GAP, rounded_times
from flexid.recording.velocities import position_noise

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from flexid.arrays import FloatArray
    from flexid.recording.channel import Channel

_SENSORS = ("link_position", "motor_position", "deflection")
_OFF = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0  # what a cubic through the others leaves over
_SPIKE = 20.0  # times the noise, by which a spike is off: 14 standard deviations
_CALM = 0.4  # of a spike, up to which the motion around it bends; where it stops dead, more than 1
_AROUND = 8  # samples on either side
_MOST = 0.01  # share of spikes, up to which a channel is mended: more are no single errors


class Mended(NamedTuple):
    """What `mended` returns."""

    channels: dict[str, Channel]
    time: FloatArray
    uncounted: tuple[int, ...]  # as in `Log`
    warnings: tuple[str, ...]


def mended(file: str, channels: dict[str, Channel], time: FloatArray) -> Mended:
    """Replace spikes of encoders, and put back lost samples."""
    if len(time) < 4 * _AROUND:
        return Mended(channels, time, (), ())
    clock = np.diff(time)
    even = clock <= GAP * np.median(clock)
    sensors = {name: channels[name] for name in _SENSORS if name in channels}
    warnings = []
    with np.errstate(all="ignore"):  # of numbers that no check has refused yet
        for name, channel in sensors.items():
            values = channel.values.copy()
            found = list(_spikes(values, even))
            if not 0 < len(found) <= max(1.0, _MOST * len(time)):
                continue
            places, sizes = map(np.array, zip(*found, strict=True))
            values[places] -= sizes
            channels = {**channels, name: replace(channel, values=values)}
            single = "sample is" if len(found) == 1 else "samples are"
            warnings.append(
                f"{file}: {channel.place}: {len(found)} {single} off the samples around "
                f"by up to {np.abs(sizes).max():.2g} rad (at {_times(time, places)}), so a cubic "
                f"through these was taken instead: check the sensor and its cable"
            )
        positions = [channels[name].values for name in sensors]
        counted = counted_anew(time, positions)
        if counted is not None:
            digit, step = np.median(np.diff(time)), np.min(np.diff(counted))
            warnings.append(rounded_times(f"{file}: the time", float(digit), float(step)))
            time = counted
        lost = lost_samples(positions, time)
    missing = lost_by_the_clock(time)
    uncounted: list[int] = []
    if missing.any():
        places = np.flatnonzero(missing)
        warnings.append(
            f"{file}: {missing.sum()} samples are missing in {len(places)} places (after "
            f"{_times(time, places)}), up to three in each, so they were put back by "
            f"interpolation: record without gaps"
        )
        channels, time = _with(channels, missing), stamped_on(time, missing)
    elif np.count_nonzero(lost) >= FEWEST_PLACES:
        places = np.flatnonzero(lost)
        columns = " and ".join(repr(channel.column) for channel in sensors.values())
        warnings.append(
            f"{file}: columns {columns}: in {len(places)} places all positions advance by whole "
            f"steps more than around them (at {_times(time, places)}): {lost.sum()} samples were "
            f"lost and the time counted from the rest, so they were put back by interpolation: "
            f"log the time of each sample"
        )
        time = counted_on(time, lost, is_span=counted is not None)
        channels = _with(channels, lost)
        uncounted = np.repeat(np.arange(len(lost)), lost).tolist()
    cautions = tuple(Caution(warning, Rank.DATA) for warning in warnings)
    return Mended(channels, time, tuple(uncounted), cautions)


def _with(channels: dict[str, Channel], lost: NDArray[np.int64]) -> dict[str, Channel]:
    """The channels with lost samples put back."""
    return {name: put_back(own, lost, held=name in INPUTS) for name, own in channels.items()}


def _off(values: FloatArray) -> FloatArray:
    """How far each value is off its neighbours, shape (n,); 0 where two are missing."""
    off = np.zeros(len(values))
    off[2:-2] = np.convolve(values, _OFF, mode="valid")
    return off


def _spikes(values: FloatArray, even: NDArray[np.bool_]) -> Iterator[tuple[int, float]]:
    """Place and size of each sample that is off alone.

    The second difference of a spike is as 1, -2, 1; that of a velocity that jumps has one sign.
    """
    off = _off(values)
    suspect = np.abs(off) > _SPIKE * position_noise(values)
    usual = values[~suspect]
    low, high = usual.min(initial=np.inf), usual.max(initial=-np.inf)
    middle = _AROUND - 1  # of the second differences, the sample's own
    for place in np.flatnonzero(suspect[_AROUND:-_AROUND]) + _AROUND:
        bends = np.diff(values[place - _AROUND : place + _AROUND + 1], 2)
        bends = (bends - np.median(bends)) / abs(off[place])
        bends[middle - 1 : middle + 2] -= np.sign(off[place]) * np.array([1.0, -2.0, 1.0])
        if np.abs(bends).max() > _CALM or not even[place - 2 : place + 2].all():
            continue
        # A counter that overflows may flicker from one end of its range to the other.
        if low <= values[place] <= high and abs(off[place]) > 0.5 * (high - low):
            continue
        yield int(place), float(off[place])


def _times(time: FloatArray, places: NDArray[np.intp]) -> str:
    return first_times([f"{time[place]:.6g} s" for place in places[:MOST_TIMES]], len(places))
