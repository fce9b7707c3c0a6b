"""Fewer samples that look the same: a line through a million has no more pixels than others."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.report.charts.description import Band, Level, Line, Mark, Points


def thinned(marks: Iterable[Mark], most: int) -> tuple[Mark, ...]:
    """Marks of a panel with about so many samples each, and no more than they have.

    Marks that stand over the same places keep the same ones of them.
    """
    marks = tuple(marks)
    groups: list[list[Line | Band | Points]] = []
    for mark in marks:
        if isinstance(mark, Level):
            continue
        alike = (group for group in groups if np.array_equal(group[0].x, mark.x, equal_nan=True))
        group = next(alike, None)
        if group is None:
            groups.append([mark])
        else:
            group.append(mark)
    found: dict[int, Mark] = {}
    for group in groups:
        kept = kept_samples([curve for mark in group for curve in _curves(mark)], most)
        found |= {id(mark): _chosen(mark, kept) for mark in group}
    return tuple(found.get(id(mark), mark) for mark in marks)


def peaks(time: FloatArray, values: FloatArray, width: int) -> tuple[FloatArray, FloatArray]:
    """The largest value of each so many samples, for what passes zero all the time.

    Parameters
    ----------
    time, values : (n,) ndarray
        A size over time.
    width : int
        Samples of a stretch; those of a last one that is not whole are left out.

    Returns
    -------
    places, largest : (n // width,) ndarray
        The middle of each stretch's samples, and its largest value.

    Examples
    --------
    >>> places, largest = peaks(np.arange(7.0), np.array([0.0, 3.0, 1.0, 2.0, 5.0, 4.0, 9.0]), 3)
    >>> places.tolist(), largest.tolist()
    ([1.0, 4.0], [3.0, 5.0])
    """
    shape = len(time) // width, width
    kept = shape[0] * width
    return time[:kept].reshape(shape).mean(axis=1), values[:kept].reshape(shape).max(axis=1)


def _curves(mark: Line | Band | Points) -> Iterator[FloatArray]:
    if isinstance(mark, Band):
        yield from (mark.low, mark.high)
    else:
        yield mark.y


def _chosen(mark: Line | Band | Points, kept: NDArray[np.intp]) -> Mark:
    if len(kept) == len(mark.x):
        return mark
    arrays = (f.name for f in fields(mark) if isinstance(getattr(mark, f.name), np.ndarray))
    return replace(mark, **{name: getattr(mark, name)[kept] for name in arrays})


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
