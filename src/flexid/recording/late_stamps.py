"""Even times with lost samples between, from stamps that were late by chance.

The samples were even, but each stamp is off by a part of a sample time, and some samples are lost.
Neither the stamps nor the sample numbers are right then. Each stamp is assigned to the nearest
multiple of the sample time, which is fitted to more and more of the stamps.
"""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.recording.sampling import MOST_JITTER, WIDE_GAP, parts_between

_FIRST = 128  # stamps of the first fit
_TRIED = np.linspace(0.9, 1.1, 201)  # sample times over the median step, for the first fit
_MOST_OFF = 0.2  # sample times, RMS of the stamps about even times: 0.29 without a common rate
_AROUND = 4  # stamps on either side, most of which are off by less than half a sample time


def even_with_losses(time: FloatArray) -> FloatArray | None:
    """Return even times without the lost samples; None if no stamps are late, or no samples lost.

    Between wide gaps, each part has its own first time.
    """
    steps = np.diff(time) / np.median(np.diff(time))
    if np.abs(steps - np.rint(steps)).max() <= MOST_JITTER:
        return None
    parts = parts_between(steps > WIDE_GAP)
    longest = time[max(parts, key=lambda part: part.stop - part.start)]
    if len(longest) < _FIRST:
        return None
    step = _fitted_step(longest)
    numbers = [_numbers(time[part], step) for part in parts]
    if all(own[-1] == len(own) - 1 for own in numbers):
        return None
    late = [time[part] - step * own for part, own in zip(parts, numbers, strict=True)]
    off = np.concatenate([own - np.median(own) for own in late])
    even = time - off
    is_common = np.std(off) <= _MOST_OFF * step and np.all(np.diff(even) > 0.0)
    return even if is_common else None


def _fitted_step(stamps: FloatArray) -> float:
    """Time between samples, by fits to more and more stamps."""
    # Lost samples lengthen the median step, but keep the phase of a rotation with the sample time.
    tried, count = _TRIED * np.median(np.diff(stamps)), _FIRST
    turned = np.exp(2j * np.pi * (stamps[:count, None] - stamps[0]) / tried)
    step = float(tried[np.argmax(np.abs(turned.mean(axis=0)))])
    while True:
        own = stamps[:count]
        number = _numbers(own, step)
        step = float(np.polyfit(number, own - own[0], 1)[0])
        if count >= len(stamps):
            return step
        count *= 2


def _numbers(stamps: FloatArray, step: float) -> NDArray[np.int64]:
    """Numbers of stamped samples among all, including the lost ones."""
    places = (stamps - stamps[0]) / step
    phase = np.angle(np.mean(np.exp(2j * np.pi * places))) / (2.0 * np.pi)
    count = np.arange(len(stamps))
    lost = np.rint(places - phase).astype(np.int64) - count
    # A single stamp may be off by more than half a step, but a loss moves all that follow.
    around = sliding_window_view(np.pad(lost, _AROUND, mode="edge"), 2 * _AROUND + 1)
    lost = np.maximum.accumulate(np.median(around, axis=1).astype(np.int64))
    return count + lost - lost[0]
