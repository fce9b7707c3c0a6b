"""Fewer samples that look the same: a line through a million has no more pixels than others."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray


def kept_samples(curves: Sequence[FloatArray], most: int) -> NDArray[np.intp]:
    """Which samples of curves over one axis have to stay, so that the curves look the same.

    Of each of many short stretches, those where a curve is smallest and largest stay, and one where
    a curve has a gap; with them the first and the last of all.

    Parameters
    ----------
    curves : sequence of (n,) ndarray
        Values of all curves at the same places.
    most : int
        About how many samples are wanted; curves that have no more keep all.

    Returns
    -------
    (m,) ndarray of int
        Their places, ascending.

    Examples
    --------
    >>> wave, spike = np.sin(np.linspace(0.0, 7.0, 10_000)), np.zeros(10_000)
    >>> spike[4321] = 5.0
    >>> kept = kept_samples([wave, spike], 400)
    >>> len(kept) <= 402, 4321 in kept, bool(wave[kept].max() == wave.max())
    (True, True, True)
    """
    n = len(curves[0])
    if n <= most:
        return np.arange(n)
    stretches = max(1, most // (2 * len(curves)))
    edges = np.linspace(0, n, stretches + 1).astype(np.intp)
    places = [0, n - 1]
    for curve in curves:
        gaps = ~np.isfinite(curve)
        low, high = np.where(gaps, np.inf, curve), np.where(gaps, -np.inf, curve)
        for start, stop in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            places.append(start + int(low[start:stop].argmin()))
            places.append(start + int(high[start:stop].argmax()))
            if gaps[start:stop].any():
                places.append(start + int(gaps[start:stop].argmax()))
    return np.unique(places)
