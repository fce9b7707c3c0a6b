"""A stream that is watched: each parameter with its interval, and the excitation, over time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexid.analysis.excitation import LOST_CONDITION, WEAK_CONDITION
from flexid.arrays import FloatArray
from flexid.report.charts.description import Axis, Band, Chart, Colour, Level, Line, Mark, Panel
from flexid.report.charts.limits import with_margin

_AROUND = 3.0  # usual half-widths of an interval that are shown beside the values
_FIRST = 10  # part of the history, one over this, in which an estimate may swing anywhere
_LEAST = 0.005  # of the value that is shown to either side of it
_MARGIN = 0.08
_COLOURS: tuple[Colour, ...] = ("blue", "orange", "green")  # of the rows


@dataclass(frozen=True)
class Moment:
    """What was known at some time.

    Parameters
    ----------
    time : float
        Of the stream, in s.
    parameters : mapping of str to (float, float, float)
        Value and ends of the interval of each parameter, in SI units.
    conditions : mapping of str to float
        Condition number of each row's normalised Gram matrix.
    """

    time: float
    parameters: Mapping[str, tuple[float, float, float]]
    conditions: Mapping[str, float]


def live_chart(
    moments: Sequence[Moment], units: Mapping[str, str], truth: Mapping[str, float] | None = None
) -> Chart:
    """A panel for each parameter that was estimated last, and one for the excitation.

    Parameters
    ----------
    moments : sequence of Moment
        From the first to the last; one or more.
    units : mapping of str to str
        Of the parameters.
    truth : mapping of str to float, optional
        True values, where they are known.

    Returns
    -------
    Chart
    """
    time = np.array([moment.time for moment in moments])
    ends = float(time[0]), max(float(time[-1]), float(time[0]) + 1.0)
    axis = Axis("time", "s", limits=ends)
    latest = moments[-1]
    panels = [
        _parameter(name, units.get(name, ""), axis, time, _history(moments, name), truth)
        for name in latest.parameters
    ]
    marks: list[Mark] = [
        Level("weak above", WEAK_CONDITION, colour="orange", dash="dotted"),
        Level("lost above", LOST_CONDITION, colour="red", dash="dotted"),
    ]
    for row, colour in zip(latest.conditions, _COLOURS, strict=False):
        values = np.array([moment.conditions.get(row, np.nan) for moment in moments])
        marks.append(Line(row, time, np.where(np.isfinite(values), values, np.nan), colour))
    panels.append(
        Panel("Excitation", axis, Axis("condition number", "", logarithmic=True), tuple(marks))
    )
    says = (
        "A band narrows as the motion teaches more, and begins anew where the drive has changed. "
        "Where the condition number is large, two coefficients look alike."
    )
    return Chart("live", "Estimates over time", says, tuple(panels), columns=2)


def _history(moments: Sequence[Moment], name: str) -> FloatArray:
    """Values and ends of the intervals, shape (n, 3); NaN where there was none."""
    none = (np.nan, np.nan, np.nan)
    history = np.array([moment.parameters.get(name, none) for moment in moments], dtype=float)
    return np.where(np.isfinite(history), history, np.nan)


def _parameter(
    name: str,
    unit: str,
    axis: Axis,
    time: FloatArray,
    history: FloatArray,
    truth: Mapping[str, float] | None,
) -> Panel:
    values, low, high = history.T
    marks: list[Mark] = [
        Band("95 % interval", time, low, high),
        Line("estimate", time, values),
    ]
    if truth is not None and name in truth:
        marks.append(Level("true value", truth[name], dash="dashed"))
    true = None if truth is None else truth.get(name)
    return Panel(
        name.replace("_", " "),
        axis,
        Axis("value", unit, limits=_frame(history, true)),
        tuple(marks),
    )


def _frame(history: FloatArray, true: float | None) -> tuple[float, float] | None:
    """Ends of what is shown: all values but the first, with what is usual of their intervals."""
    values, low, high = history[len(history) // _FIRST :].T
    values = values[np.isfinite(values)]
    if not len(values):
        return None
    half = (high - low)[np.isfinite(high - low)] / 2
    around = _AROUND * float(np.median(half)) if len(half) else 0.0
    around = max(around, _LEAST * abs(float(values[-1]))) or 1.0
    shown = [float(values.min()), float(values.max())] + ([] if true is None else [true])
    return with_margin(min(shown) - around, max(shown) + around, _MARGIN)
