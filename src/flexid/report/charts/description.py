"""What a figure shows, without a word on how it is drawn.

A chart is a grid of panels, and a panel a stack of marks over two axes. The same chart is drawn by
Matplotlib (`flexid.report.charts.figure`) and by the browser (`flexid.report.charts.document` makes
what the page's script reads), so that a figure in a file, in a report and in the studio shows the
same data.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.evidence import Verdict

Colour = Literal["ink", "blue", "orange", "green", "red", "grey"]
"""What a colour is called; each way of drawing has its own shade of it."""

Dash = Literal["solid", "dashed", "dotted"]

VERDICT_COLOURS: Mapping[Verdict, Colour] = {
    "determined": "green",
    "weak": "orange",
    "undetermined": "red",
}
"""Colour of each verdict, which its word stands beside."""


@dataclass(frozen=True)
class Axis:
    """An axis of a panel.

    Parameters
    ----------
    label : str
        What it measures, without the unit.
    unit : str
        Its unit; empty if it has none.
    logarithmic : bool
        Whether it is one.
    limits : tuple of float, optional
        Its ends; those of the data if not given.
    categories : tuple of str
        Names at 0, 1, 2, ..., from the top or from the left, in place of numbers.
    step : float, optional
        Between two values that are labelled, where one is natural, as 90 for degrees.
    """

    label: str
    unit: str = ""
    logarithmic: bool = False
    limits: tuple[float, float] | None = None
    categories: tuple[str, ...] = ()
    step: float | None = None


@dataclass(frozen=True, eq=False)
class Line:
    """A line through points; it has a gap where a value is not finite.

    Parameters
    ----------
    label : str
        What the legend calls it; nothing if empty.
    x, y : (n,) ndarray
        Its points, in the units of the axes.
    colour : Colour
        Its colour.
    width : float
        Its width in points.
    dash : {"solid", "dashed", "dotted"}
        Its stroke.
    filled : bool
        Whether what it encloses is shaded.
    """

    label: str
    x: FloatArray
    y: FloatArray
    colour: Colour = "blue"
    width: float = 1.3
    dash: Dash = "solid"
    filled: bool = False


@dataclass(frozen=True, eq=False)
class Band:
    """What lies between two lines: an interval over time, or over frequency.

    Parameters
    ----------
    label : str
        What the legend calls it; nothing if empty.
    x, low, high : (n,) ndarray
        Both lines, in the units of the axes.
    colour : Colour
        Its colour.
    """

    label: str
    x: FloatArray
    low: FloatArray
    high: FloatArray
    colour: Colour = "blue"


@dataclass(frozen=True, eq=False)
class Points:
    """Points without a line.

    Parameters
    ----------
    label : str
        What the legend calls them; nothing if empty.
    x, y : (n,) ndarray
        In the units of the axes.
    colour : Colour
        Their colour.
    size : float
        Their diameter in points.
    faint : bool
        Whether they are drawn weakly, as what is not trusted.
    stems : bool
        Whether each stands on a line from the bottom of the panel.
    """

    label: str
    x: FloatArray
    y: FloatArray
    colour: Colour = "blue"
    size: float = 4.0
    faint: bool = False
    stems: bool = False


@dataclass(frozen=True)
class Level:
    """A line across the panel at one value.

    Parameters
    ----------
    label : str
        What the legend calls it; nothing if empty.
    value : float
        Where it is.
    along : {"x", "y"}
        The axis that it marks a value of: "y" is a horizontal line.
    colour : Colour
        Its colour.
    dash : {"solid", "dashed", "dotted"}
        Its stroke.
    """

    label: str
    value: float
    along: Literal["x", "y"] = "y"
    colour: Colour = "ink"
    dash: Dash = "solid"


Mark = Line | Band | Points | Level


@dataclass(frozen=True)
class Panel:
    """Marks over two axes.

    Parameters
    ----------
    title : str
        What stands above it; may have two lines.
    x, y : Axis
        Its axes.
    marks : tuple
        What is drawn, from the back to the front.
    height : float
        Over that of the others; a row of panels is as high as the highest.
    span : int
        Columns of the chart that it takes.
    colour : Colour
        Of its title: that of a verdict, which the title names as well.
    """

    title: str
    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    height: float = 1.0
    span: int = 1
    colour: Colour = "ink"


@dataclass(frozen=True)
class Chart:
    """A figure.

    Parameters
    ----------
    name : str
        What its file is called.
    title : str
        What it is of.
    says : str
        One sentence on what to see in it.
    panels : tuple of Panel
        Row after row.
    columns : int
        Panels in a row.
    linked : bool
        Whether panels of one column have one x axis, so that a zoom of one is a zoom of all.
    """

    name: str
    title: str
    says: str
    panels: tuple[Panel, ...]
    columns: int = 1
    linked: bool = True
