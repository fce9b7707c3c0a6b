"""Channels shifted in time by any part of a sample, without colouring their noise.

Interpolation averages neighbouring samples: half-way between two samples it takes the fast half of
the noise away, and whatever judges residuals by the noise of the encoder is misled. A shift of the
phase alone delays without attenuating anything: a joint's motion by just what is wanted, and white
noise stays white. It depends smoothly on the delay, so that a fit may seek it.
"""

from math import ceil
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray

_SIZES = (8, 9, 10, 12, 15)  # times a power of two: lengths that are transformed quickly
_EDGE = 16  # samples at either end in which what was turned round about it shows


def later(values: FloatArray, samples: float) -> FloatArray:
    """A channel later by so many samples of either sign, shape (n,); see `spoilt`."""
    if samples == 0.0 or len(values) < 2:
        return values.copy()
    own = _turned_round(values)
    moved = np.fft.irfft(own.spectrum * np.exp(-1j * samples * own.turns), own.period)
    places = np.arange(len(values)) - samples
    return moved[: len(values)] + own.first + own.slope * places


def rate_of_later(values: FloatArray, samples: float) -> FloatArray:
    """Derivative of `later` by the number of samples, shape (n,)."""
    if len(values) < 2:
        return np.zeros_like(values)
    own = _turned_round(values)
    turned = -1j * own.turns * np.exp(-1j * samples * own.turns)
    return np.fft.irfft(own.spectrum * turned, own.period)[: len(values)] - own.slope


class _TurnedRound(NamedTuple):
    """A channel less the line between its ends, turned round about both of them: it is periodic."""

    spectrum: NDArray[np.complex128]  # (period / 2 + 1,)
    turns: FloatArray  # the same: rad per sample
    period: int
    first: float  # where the line begins
    slope: float  # of the line, per sample


def _turned_round(values: FloatArray) -> _TurnedRound:
    more = _quick(len(values) - 1) - (len(values) - 1)
    whole = np.concatenate((values, 2.0 * values[-1] - values[-2 : -2 - more : -1]))
    half = len(whole) - 1
    slope = float(whole[-1] - whole[0]) / half
    left = whole - (whole[0] + slope * np.arange(half + 1))
    spectrum = np.fft.rfft(np.concatenate((left, -left[-2:0:-1])))
    turns = np.pi * np.arange(half + 1) / half
    return _TurnedRound(spectrum, turns, 2 * half, float(whole[0]), slope)


def _quick(length: int) -> int:
    """The next length that is transformed quickly."""
    power = max(0, length.bit_length() - 4)
    return min(s << p for s in _SIZES for p in (power, power + 1) if s << p >= length)


def spoilt(samples: float) -> tuple[int, int]:
    """How many entries at the beginning and at the end `later` cannot know."""
    edge = 0 if samples == round(samples) else _EDGE
    return max(ceil(samples), 0) + edge, max(ceil(-samples), 0) + edge
