"""A chart as a document for JSON, which the script of a page draws.

Each array stands in it once, under ``arrays``, and marks have its place there: panels over one axis
share it. Lines of more samples than a screen has pixels keep those that one would see.
"""

from __future__ import annotations

from dataclasses import asdict, fields
from math import floor, log10
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.report.charts.decimate import thinned
from flexid.report.charts.description import Axis, Band, Chart, Level, Line, Mark, Panel, Points

_MOST = 1600  # samples of a curve: a page is 1000 pixels wide, and each needs one or two
_MOST_BESIDE = 1000  # the same where panels stand beside each other
_DIGITS = {"x": 5, "y": 4}  # after the first of what is shown: less than a tenth of a pixel

_KINDS = {Line: "line", Band: "band", Points: "points", Level: "level"}


def chart_document(chart: Chart) -> dict[str, Any]:
    """What a page's script draws a chart from, ready for JSON.

    Parameters
    ----------
    chart : Chart
        What is drawn.

    Returns
    -------
    dict
        The fields of the chart; each mark with its ``kind``, and with a place in ``arrays`` for
        each of its arrays, in which None is a gap.
    """
    arrays = _Arrays()
    most = _MOST if chart.columns == 1 else _MOST_BESIDE
    panels = [_panel_document(panel, most, arrays) for panel in chart.panels]
    return {
        "name": chart.name,
        "title": chart.title,
        "says": chart.says,
        "columns": chart.columns,
        "linked": chart.linked,
        "panels": panels,
        "arrays": arrays.lists,
    }


class _Arrays:
    """Arrays of a document, each once."""

    def __init__(self) -> None:
        self.lists: list[list[float | None]] = []
        self._places: dict[bytes, int] = {}

    def place(self, values: FloatArray, axis: Axis, digits: int) -> int:
        """Where an array of values along an axis stands; it is added if it is new."""
        rounded = _rounded(values, axis, digits)
        place = self._places.setdefault(rounded.tobytes(), len(self.lists))
        if place == len(self.lists):
            finite = np.isfinite(rounded).tolist()
            pairs = zip(rounded.tolist(), finite, strict=True)
            self.lists.append([value if usable else None for value, usable in pairs])
        return place


def _rounded(values: FloatArray, axis: Axis, digits: int) -> FloatArray:
    """Values without digits that nobody could see, and that would double the page's size."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return values
    if axis.logarithmic:
        return np.array([float(f"{value:.{digits + 1}g}") for value in values.tolist()])
    size = float(np.ptp(finite)) or float(np.abs(finite).max())
    if axis.limits is not None:  # what leaves the frame does not coarsen what is in it
        size = min(size, axis.limits[1] - axis.limits[0])
    return np.round(values, digits - floor(log10(size))) + 0.0 if size else values


def _panel_document(panel: Panel, most: int, arrays: _Arrays) -> dict[str, Any]:
    marks = [_mark_document(mark, panel, arrays) for mark in thinned(panel.marks, most)]
    return {
        "title": panel.title,
        "x": asdict(panel.x),
        "y": asdict(panel.y),
        "height": panel.height,
        "span": panel.span,
        "colour": panel.colour,
        "marks": marks,
    }


def _mark_document(mark: Mark, panel: Panel, arrays: _Arrays) -> dict[str, Any]:
    document: dict[str, Any] = {"kind": _KINDS[type(mark)]}
    for field in fields(mark):
        value = getattr(mark, field.name)
        if isinstance(value, np.ndarray):
            which = "x" if field.name == "x" else "y"
            axis, digits = getattr(panel, which), _DIGITS[which]
            value = arrays.place(np.asarray(value, dtype=np.float64), axis, digits)
        document[field.name] = value
    return document
