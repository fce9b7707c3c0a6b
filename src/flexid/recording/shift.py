"""Channels shifted in time by any part of a sample, without colouring their noise.

Interpolation averages neighbouring samples: half-way between two samples it takes the fast half of
the noise away, and whatever judges residuals by the noise of the encoder is misled. An all-pass
filter delays without attenuating anything. The one whose delay is flattest at low frequency
(Thiran, IEEE Trans. Circuit Theory 18, 1971) delays a joint's motion by just what is wanted and
leaves white noise white.
"""

from functools import lru_cache
from math import comb

import numpy as np

from flexid.arrays import FloatArray

ORDER = 3
SETTLING = 32  # samples at the beginning that the all-pass filter spoils: its poles lie within 0.54
_LASTING = 80  # samples, after which the response is below 1e-16


def later(values: FloatArray, samples: float) -> FloatArray:
    """A channel later by so many samples of either sign, shape (n,); see `spoilt`."""
    whole = round(samples)
    fraction = samples - whole
    if fraction == 0.0:
        return _rolled(values, whole)
    # From the channel's first value on, not from zero, so that little is left to settle.
    first = values[0]
    delayed = first + np.convolve(values - first, _response(fraction))[: len(values)]
    return _rolled(delayed, whole - ORDER)


@lru_cache(maxsize=64)  # most passes over a log take the delay of the one before
def _response(fraction: float) -> FloatArray:
    """Impulse response of Thiran's all-pass filter, shape (_LASTING,).

    Its delay exceeds `ORDER` samples by a fraction from -0.5 to 0.5; the numerator is the
    denominator reversed. Thiran (1971), eq. (16):
    a_k = (-1)^k C(N, k) prod_n (D - N + n) / (D - N + k + n).
    """
    delay, n = ORDER + fraction, np.arange(ORDER + 1)
    products = [np.prod((delay - ORDER + n) / (delay - ORDER + k + n)) for k in n[1:]]
    denominator = [1.0, *((-1) ** k * comb(ORDER, k) * p for k, p in enumerate(products, 1))]
    response = np.zeros(_LASTING)  # by hand: SciPy's package loads slowly
    response[: ORDER + 1] = denominator[::-1]
    for i in range(1, _LASTING):
        back = response[max(i - ORDER, 0) : i][::-1]
        response[i] -= denominator[1 : 1 + len(back)] @ back
    return response


def spoilt(samples: float) -> tuple[int, int]:
    """How many entries at the beginning and at the end `later` cannot know."""
    whole = round(samples)
    if samples == whole:
        return max(whole, 0), max(-whole, 0)
    return max(whole - ORDER + SETTLING, 0), max(ORDER - whole, 0)


def _rolled(values: FloatArray, whole: int) -> FloatArray:
    """Shift by whole samples; the ends repeat the outermost value."""
    places = np.clip(np.arange(len(values)) - whole, 0, len(values) - 1)
    return values[places]
