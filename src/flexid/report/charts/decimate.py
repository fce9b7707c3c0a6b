"""Fewer samples with the same look: a line of a million samples has no more pixels than others."""

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.report.charts.description import Level, Mark


def thinned(mark: Mark, most: int) -> Mark:
    """A mark with about `most` samples, its extremes and gaps among them."""
    if isinstance(mark, Level) or len(mark.x) <= most:
        return mark
    arrays = {f.name: getattr(mark, f.name) for f in fields(mark)}
    arrays = {name: a for name, a in arrays.items() if isinstance(a, np.ndarray)}
    kept = kept_samples([a for name, a in arrays.items() if name != "x"], most)
    return replace(mark, **{name: a[kept] for name, a in arrays.items()})


def peaks(time: FloatArray, values: FloatArray, width: int) -> tuple[FloatArray, FloatArray]:
    """Middle and largest value of each `width` samples, shape (n // width,) each.

    Examples
    --------
    >>> places, largest = peaks(np.arange(7.0), np.array([0.0, 3.0, 1.0, 2.0, 5.0, 4.0, 9.0]), 3)
    >>> places.tolist(), largest.tolist()
    ([1.0, 4.0], [3.0, 5.0])
    """
    shape = len(time) // width, width
    kept = shape[0] * width
    return time[:kept].reshape(shape).mean(axis=1), values[:kept].reshape(shape).max(axis=1)


def kept_samples(curves: Sequence[FloatArray], most: int) -> NDArray[np.intp]:
    """Places, ascending, of the samples without which curves over one axis would look different.

    Of each of many short stretches these are the smallest and the largest value of every curve, and
    a gap; and the first and the last sample of all.

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
