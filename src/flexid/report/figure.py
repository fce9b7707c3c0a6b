"""A chart drawn with Matplotlib, in one look for all figures."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from math import inf, log10
from pathlib import Path
from textwrap import fill
from typing import Literal

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis as Ruler
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec
from matplotlib.ticker import (
    FuncFormatter,
    LogLocator,
    MaxNLocator,
    MultipleLocator,
    NullFormatter,
    NullLocator,
    ScalarFormatter,
)
from matplotlib.transforms import Bbox

from flexid.errors import SettingError
from flexid.report.chart import (
    Axis,
    Band,
    Chart,
    Colour,
    Dash,
    Line,
    Mark,
    Panel,
    Points,
    thinned,
)

COLOURS: Mapping[Colour, str] = {
    "ink": "#1b1f24",
    "blue": "#1f6fb4",
    "orange": "#d9730d",
    "green": "#2e8b57",
    "red": "#c0392b",
    "grey": "#8a939c",
}
"""The shade of each colour of a chart."""

INK, BLUE, ORANGE, GREEN, RED, GREY = COLOURS.values()
GRID = "#e3e6e9"

STYLE = mpl.rc_params_from_file(Path(__file__).with_name("figure.mplstyle"), False, False)
"""The look of all figures; a Matplotlib style sheet."""


class NotebookFigure(Figure):
    """A figure that a notebook shows although pyplot does not know it."""

    def _repr_png_(self) -> bytes:
        with io.BytesIO() as file:
            self.savefig(file, format="png", dpi=self.dpi)
            return file.getvalue()


def new_figure(width: float, height: float) -> Figure:
    """Figure in inches with the common look; needs no display."""
    with mpl.rc_context(STYLE):
        figure = NotebookFigure(figsize=(width, height))
    FigureCanvasAgg(figure)  # else whoever asks how large a text is makes a canvas of its own
    return figure


def save(figure: Figure, directory: Path, name: str, formats: Sequence[str] = ("png",)) -> None:
    """Write the figure as ``directory/name.format`` for each format."""
    with mpl.rc_context(STYLE):
        for extension in formats:
            # Without a date the same result gives the same file
            metadata = {"CreationDate": None} if extension == "pdf" else None
            figure.savefig(directory / f"{name}.{extension}", metadata=metadata)


WIDTH = 7.2  # inches, of a figure in a file: that of a printed page
NARROW = 3.7  # inches: that of a telephone, with one panel in a row
_ROW = 1.75  # inches, of a row of panels of height 1
_EDGE = 0.3  # inches, that all panels together leave for labels
_LINE = 0.2  # inches, of a line of the title or of the legend
_GAP = 0.09  # inches, around each panel with all its labels
_SAMPLES = 240  # of a curve in an inch, which has 200 pixels in a file
_LETTERS = 11.4, 15.3  # in an inch of the title; of the legend and of the title of a small panel
_HANDLE = 11  # letters that the handle of an entry takes
_FEW = 2.5  # panels in a row, from which on their text is small
_MARGIN = 0.06  # of what is shown, beside points
_MINOR = 4  # decades of an axis that has marks between them
_DASHES: dict[Dash, str] = {"solid": "-", "dashed": "--", "dotted": ":"}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def draw(chart: Chart, ax: Axes | None = None) -> Figure:
    """A drawing: the title above, a legend of all panels below; or in the place of an axes.

    Panels of one column share their x axis if the chart is linked, and panels of one row share a y
    axis that is the same, limits and all; a shared axis is labelled once. The only mark of a panel
    needs no entry in the legend.
    """
    return _drawn(chart, WIDTH) if ax is None else _draw_in_place(ax, chart)


def _drawn(chart: Chart, width: float) -> Figure:
    """A figure of so many inches; a narrow one has one panel in a row."""
    if width <= NARROW and chart.columns > 1:
        panels = tuple(replace(panel, span=1) for panel in chart.panels)
        chart = replace(chart, columns=1, panels=panels, linked=False)
    with mpl.rc_context(STYLE):
        figure = _new_figure(chart, width)
        _fill_grid(figure, chart, width)
        _draw_legend(figure, chart, width)
        _lay_out(figure, chart)
    return figure


drawn_once = lru_cache(maxsize=16)(_drawn)
"""The drawing of a chart in a width, the same one for its file and its page."""


def _lay_out(figure: Figure, chart: Chart) -> None:
    """Place the panels with room for their labels, and labels of y axes below each other.

    Each text is measured once, which takes half the time of Matplotlib's constrained layout.
    """
    gap, renderer = _GAP * figure.dpi, FigureCanvasAgg(figure).get_renderer()
    shares = np.array(_heights(chart)) / sum(_heights(chart))
    left, right, labels = np.zeros((3, chart.columns))
    above, below = np.zeros((2, len(shares)))
    places: list[tuple[Axes, range, int]] = []
    for ax in figure.axes:
        place, box = ax.get_subplotspec(), ax.bbox
        whole = ax.get_tightbbox(renderer, bbox_extra_artists=[], for_layout_only=True)
        assert place is not None
        assert whole is not None
        columns, row = place.colspan, place.rowspan.start
        left[columns[0]] = max(left[columns[0]], box.x0 - whole.x0)
        right[columns[-1]] = max(right[columns[-1]], whole.x1 - box.x1)
        above[row] = max(above[row], whole.y1 - box.y1)
        below[row] = max(below[row], box.y0 - whole.y0)
        distance = box.x0 - ax.yaxis.label.get_position()[0]
        labels[columns[0]] = max(labels[columns[0]], distance)
        places.append((ax, columns, row))
    title = figure.texts[0]
    title.set_y(1.0 - gap / figure.bbox.height)
    top = figure.bbox.height - gap - title.get_window_extent(renderer).height
    bottom = sum(legend.get_window_extent(renderer).height for legend in figure.legends)
    widths = figure.bbox.width - np.sum(left + right + gap) - gap
    widths = np.full(chart.columns, widths / chart.columns)
    heights = shares * (top - bottom - gap - np.sum(above + below + gap))
    starts = np.cumsum(gap + left + widths + right) - widths - right
    lowest = top - np.cumsum(gap + above + heights + below) + below
    for ax, columns, row in places:
        start, end = starts[columns[0]], starts[columns[-1]] + widths[columns[-1]]
        box = Bbox.from_bounds(start, lowest[row], end - start, heights[row])
        ax.set_position(box.transformed(figure.transFigure.inverted()))
        ax.yaxis.set_label_coords(-labels[columns[0]] / (end - start), 0.5)


def save_charts(
    charts: Iterable[Chart], directory: Path, formats: Sequence[str] = ("png",)
) -> None:
    """Write each chart as ``directory/name.format`` for each format."""
    for chart in charts:
        save(drawn_once(chart, WIDTH), directory, chart.name, formats)


def _rows(chart: Chart) -> list[list[tuple[int, Panel]]]:
    """Panels row by row, each with the column in which it begins."""
    rows: list[list[tuple[int, Panel]]] = []
    free = 0
    for panel in chart.panels:
        if panel.span > free:
            rows.append([])
            free = chart.columns
        rows[-1].append((chart.columns - free, panel))
        free -= panel.span
    return rows


def _heights(chart: Chart) -> list[float]:
    return [max(panel.height for _, panel in row) for row in _rows(chart)]


def _new_figure(chart: Chart, width: float) -> Figure:
    """A figure with a title, as high as its panels and its text need."""
    title = fill(chart.title, round(_LETTERS[0] * width))
    lines = len(title.splitlines()) + -(-len(_labels(chart)) // _legend_columns(chart, width))
    figure = new_figure(width, _ROW * sum(_heights(chart)) + _LINE * lines + _EDGE)
    figure.set_layout_engine("none")
    figure.suptitle(title, x=0.01, y=1.0, ha="left", va="top", fontsize=10, parse_math=False)
    return figure


def _draw_in_place(ax: Axes, chart: Chart) -> Figure:
    """Draw the panels where an axes was, with one legend, and the title where they have none."""
    place, figure = ax.get_subplotspec(), ax.get_figure(root=True)
    if place is None or figure is None:
        raise SettingError("ax", "has no place in a grid: make it by plt.subplots")
    ax.remove()
    there = len(figure.axes)
    with mpl.rc_context(STYLE):
        _fill_grid(figure, chart, WIDTH, place)
        panels = figure.axes[there:]
        if not panels[0].get_title():
            panels[0].set_title(chart.title, fontsize="small", loc="left", parse_math=False)
        labelled = [axes for axes in panels if axes.get_legend_handles_labels()[1]]
        for axes in labelled[:1]:
            axes.legend(fontsize="x-small")
    return figure


def _fill_grid(
    figure: Figure, chart: Chart, width: float, inside: SubplotSpec | None = None
) -> None:
    """Draw the panels where they belong, with axes that they share."""
    rows = _rows(chart)
    divide = figure.add_gridspec if inside is None else inside.subgridspec
    grid = divide(len(rows), chart.columns, height_ratios=_heights(chart))
    above: dict[tuple[int, int], Axes] = {}
    for i, row in enumerate(rows):
        left: tuple[Axis, Axes] | None = None
        for column, panel in row:
            share = above.get((column, panel.span)) if chart.linked else None
            alike = left is not None and left[0] == panel.y and panel.y.limits is not None
            same = left[1] if left is not None and alike else None
            place = grid[i, column : column + panel.span]
            ax = figure.add_subplot(place, sharex=share, sharey=same)
            _fill(ax, panel, chart.columns / panel.span, width)
            if share is not None:
                _unlabel(share.xaxis)
            if same is not None:
                _unlabel(ax.yaxis)
            above[column, panel.span] = ax
            left = (panel.y, ax)
    last = [_label(panel.x) for _, panel in rows[-1]]
    if chart.linked:
        for ax in above.values():  # where the last row is not full, its neighbour has the label
            if ax not in figure.axes[-len(rows[-1]) :] and ax.get_xlabel() in last:
                ax.xaxis.set_label_text("")


def _fill(ax: Axes, panel: Panel, beside: float, width: float) -> None:
    """Draw a panel of a figure that has room for so many of them in a row."""
    lines = any(isinstance(mark, Line | Band) for mark in panel.marks)
    ax.margins(0.0 if lines and not panel.y.categories else _MARGIN, _MARGIN)
    for mark in panel.marks:
        _draw(ax, thinned(mark, round(_SAMPLES * width)))
    crowd = beside * WIDTH / width
    _set_axis(ax, "x", panel.x, 9 if crowd < 1.5 else 5 if crowd < _FEW else 3)
    _set_axis(ax, "y", panel.y, 5)
    for mark in panel.marks:
        if isinstance(mark, Points) and mark.stems:  # now that the panel has a bottom
            ax.vlines(mark.x, ax.get_ylim()[0], mark.y, color=COLOURS[mark.colour])
    if beside > _FEW:
        ax.xaxis.label.set_fontsize(8)
    big = beside == 1.0 and width > NARROW
    letters = round(_LETTERS[0 if big else 1] * width / beside)
    title = "\n".join(fill(line, letters) for line in panel.title.splitlines())
    colour = COLOURS[panel.colour]
    ax.set_title(title, color=colour, fontsize=10 if big else 8, parse_math=False, y=1.0)


def _draw(ax: Axes, mark: Mark) -> None:
    colour, label = COLOURS[mark.colour], mark.label or "_"
    if isinstance(mark, Line):
        if mark.filled:
            ax.fill(mark.x, mark.y, color=colour, alpha=0.18, linewidth=0)
        style = {"linestyle": _DASHES[mark.dash], "linewidth": mark.width}
        ax.plot(mark.x, mark.y, color=colour, label=label, **style)
    elif isinstance(mark, Band):
        shade = {"color": colour, "alpha": 0.25, "linewidth": 0}
        ax.fill_between(mark.x, mark.low, mark.high, label=label, **shade)
    elif isinstance(mark, Points):
        style = {"color": colour, "alpha": 0.25 if mark.faint else 1.0, "markeredgewidth": 0}
        ax.plot(mark.x, mark.y, "o", markersize=mark.size, label=label, **style)
    else:
        line = ax.axhline if mark.along == "y" else ax.axvline
        line(mark.value, color=colour, label=label, linestyle=_DASHES[mark.dash], linewidth=1.0)


def _set_axis(ax: Axes, which: Literal["x", "y"], axis: Axis, labels: int) -> None:
    """Label, scale, limits and at most so many numbers of an axis."""
    ruler = ax.xaxis if which == "x" else ax.yaxis
    ruler.set_label_text(_label(axis), parse_math=False)
    limits = axis.limits
    if axis.categories:
        count = len(axis.categories)
        ruler.set_ticks(range(count), axis.categories, parse_math=False)
        limits = (count - 0.5, -0.5) if which == "y" else (-0.5, count - 0.5)
    elif axis.logarithmic:
        ax.set(**{f"{which}scale": "log"})
        _set_decades(ruler, limits, labels)
    else:
        several = MaxNLocator(labels, steps=[1, 2, 2.5, 5, 10])
        ruler.set_major_locator(several if axis.step is None else MultipleLocator(axis.step))
        ruler.set_major_formatter(ScalarFormatter(useOffset=False))
    if limits is not None:
        ax.set(**{f"{which}lim": limits})


def _set_decades(ruler: Ruler, limits: tuple[float, float] | None, labels: int) -> None:
    """Numbers of a logarithmic axis: powers of ten, or others where there is less than a decade."""
    decades = inf if limits is None else log10(limits[1] / limits[0])
    ruler.set_major_locator(LogLocator(numticks=labels + 2))
    ruler.set_major_formatter(FuncFormatter(_power))
    if decades > _MINOR:
        ruler.set_minor_locator(NullLocator())
    few = FuncFormatter(lambda value, _: f"{value:g}")
    ruler.set_minor_formatter(few if decades < 1.0 else NullFormatter())


def _power(value: float, _: int) -> str:
    """A power of ten as an axis has it."""
    exponent = round(log10(value)) if value > 0.0 else 0
    return f"{value:g}" if -1 <= exponent <= 3 else "10" + str(exponent).translate(_SUPERSCRIPTS)


def _label(axis: Axis) -> str:
    unit = axis.unit.replace("^2", "²").replace("^3", "³")
    return f"{axis.label} ({unit})" if unit else axis.label


def _unlabel(ruler: Ruler) -> None:
    """Leave the numbers and the label of an axis to the panel that shares it."""
    ruler.set_tick_params(labelbottom=False, labelleft=False)
    ruler.set_label_text("")


def _legend_columns(chart: Chart, width: float) -> int:
    """As many columns of entries as the figure is wide enough for."""
    lengths = [len(label) + _HANDLE for label in _labels(chart)]
    for columns in range(len(lengths), 1, -1):
        widths = (int(part.max()) for part in np.array_split(lengths, columns))
        if sum(widths) <= _LETTERS[1] * width:
            return columns
    return 1


def _labels(chart: Chart) -> list[str]:
    """What the legend names, each once."""
    found: dict[str, None] = {}
    for panel in chart.panels:
        labels = dict.fromkeys(mark.label for mark in panel.marks if mark.label)
        if len(labels) > 1:
            found |= labels
    return list(found)


def _draw_legend(figure: Figure, chart: Chart, width: float) -> None:
    handles: dict[str, Artist] = {}
    for ax in figure.axes:
        for handle, label in zip(*ax.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    labels = _labels(chart)
    if not labels:
        return
    legend = figure.legend(
        [handles[one] for one in labels],
        [fill(one, round(_LETTERS[1] * width) - _HANDLE) for one in labels],
        loc="lower left",
        ncols=_legend_columns(chart, width),
    )
    for text in legend.get_texts():
        text.set_parse_math(False)
