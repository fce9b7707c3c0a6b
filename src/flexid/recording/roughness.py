"""Roughness of positions at given times, by which they decide which times are right."""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from flexid.arrays import FloatArray

_MOST_OF = 0.9  # quantile that ignores rare jumps and wraps
_SMOOTHER = 1.05  # least ratio of roughness: a log whose encoder hides its clock has 1.00004
_ROUNDING = 1e-9  # of a position's range
_FEWEST = 5  # samples: one and its four neighbours


def are_smoother_at(
    times: FloatArray, others: FloatArray, positions: Sequence[FloatArray], parts: Sequence[slice]
) -> bool:
    """Whether positions are smoother at `times` than at `others`, by the most conclusive one."""
    gains = [_gain(times, others, values, parts) for values in positions]
    return max(gains, key=abs, default=0.0) > np.log(_SMOOTHER)


def _gain(
    times: FloatArray, others: FloatArray, values: FloatArray, parts: Sequence[slice]
) -> float:
    """Logarithm of a position's roughness at `others` over that at `times`."""
    gains, lengths = [0.0], [1]
    for part in parts:
        own = values[part]
        if len(own) < _FEWEST:
            continue
        # A quantile, to ignore rare jumps and wraps.
        off = np.array(
            [np.quantile(_cubic_residual(at[part], own), _MOST_OF) for at in (times, others)]
        )
        rounding = _ROUNDING * np.ptp(own)
        if off.max() > rounding:  # a position at rest is no evidence
            here, there = np.log(np.maximum(off, rounding))
            gains.append(float(there - here))
            lengths.append(len(own))
    return float(np.average(gains, weights=lengths))


def _cubic_residual(time: FloatArray, values: FloatArray) -> FloatArray:
    """Distance of samples from the cubic through four neighbours over its noise, (n - 4,)."""
    ahead = sliding_window_view(time, _FEWEST) - time[2:-2, None]
    others = [0, 1, 3, 4]
    weights = np.ones((len(ahead), len(others)))
    for i, place in enumerate(others):
        for other in others:
            if other != place:
                weights[:, i] *= ahead[:, other] / (ahead[:, other] - ahead[:, place])
    around = sliding_window_view(values, _FEWEST)[:, others]
    off = values[2:-2] - np.sum(weights * around, axis=1)
    return np.abs(off) / np.sqrt(1.0 + np.sum(weights**2, axis=1))
