"""Content of figures: a chart is a grid of panels, and each panel has marks over two axes."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray

Colour = Literal["ink", "blue", "orange", "green", "red", "grey"]
Dash = Literal["solid", "dashed", "dotted"]


@dataclass(frozen=True)
class Axis:
    """An axis of a panel."""

    label: str  # without the unit
    unit: str = ""
    logarithmic: bool = False
    limits: tuple[float, float] | None = None  # by default the range of the data
    step: float | None = None  # between labelled values, such as 90 for degrees; by default chosen


@dataclass(frozen=True, eq=False)
class Line:
    """A line through points, with a gap where a value is not finite."""

    label: str  # in the legend; empty: no entry
    x: FloatArray  # (n,)
    y: FloatArray  # (n,)
    colour: Colour = "blue"
    width: float = 1.3  # points
    dash: Dash = "solid"


@dataclass(frozen=True, eq=False)
class Band:
    """The area between two lines: an interval over time, or over frequency."""

    label: str
    x: FloatArray  # (n,)
    low: FloatArray  # (n,)
    high: FloatArray  # (n,)
    colour: Colour = "blue"


@dataclass(frozen=True)
class Level:
    """A line across the panel at one value of an axis."""

    label: str
    value: float
    along: Literal["x", "y"] = "y"  # the axis of the value: "y" is a horizontal line
    colour: Colour = "ink"
    dash: Dash = "solid"


Mark = Line | Band | Level


@dataclass(frozen=True)
class Panel:
    """Marks over two axes, from the back to the front."""

    title: str  # one line or two
    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    height: float = 1.0  # relative to the other rows
    span: int = 1  # number of columns that the panel spans


@dataclass(frozen=True)
class Chart:
    """A figure: panels row by row; panels of one column share their x axis."""

    name: str  # of the file
    title: str
    says: str  # caption: what to look for
    panels: tuple[Panel, ...]
    columns: int = 1


def whole_decades(values: FloatArray) -> tuple[float, float]:
    """Return powers of ten around the positive values, so that a logarithmic axis has labels."""
    usable = values[np.isfinite(values) & (values > 0.0)]
    if not len(usable):
        return 1.0, 10.0
    lowest, highest = np.floor(np.log10(usable.min())), np.ceil(np.log10(usable.max()))
    return float(10.0**lowest), float(10.0 ** max(highest, lowest + 1.0))


def with_margin(low: float, high: float, margin: float) -> tuple[float, float]:
    """Return limits widened on both sides by a share `margin` of their distance."""
    return low - margin * (high - low), high + margin * (high - low)


def thinned(mark: Mark, most: int) -> Mark:
    """Return a mark with about `most` samples, which include its extremes and gaps."""
    if isinstance(mark, Level) or len(mark.x) <= most:
        return mark
    arrays = {f.name: getattr(mark, f.name) for f in fields(mark)}
    arrays = {name: a for name, a in arrays.items() if isinstance(a, np.ndarray)}
    kept = kept_samples([a for name, a in arrays.items() if name != "x"], most)
    return replace(mark, **{name: a[kept] for name, a in arrays.items()})


def peaks(time: FloatArray, values: FloatArray, width: int) -> tuple[FloatArray, FloatArray]:
    """Return mean time and largest value of each `width` samples, shape (n // width,) each."""
    shape = len(time) // width, width
    kept = shape[0] * width
    return time[:kept].reshape(shape).mean(axis=1), values[:kept].reshape(shape).max(axis=1)


def kept_samples(curves: Sequence[FloatArray], most: int) -> NDArray[np.intp]:
    """Return indices of the extremes and gaps of each short stretch, and of both ends."""
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
