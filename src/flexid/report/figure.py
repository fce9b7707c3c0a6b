"""Charts drawn with Matplotlib in one style: as a file, or as SVG in a page."""

import io
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from html import escape
from pathlib import Path
from textwrap import fill
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib import ticker
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.gridspec import SubplotSpec

from flexid.errors import SettingError
from flexid.report.chart import Axis, Band, Chart, Colour, Dash, Line, Mark, Panel, thinned

COLOURS: Mapping[Colour, str] = {
    "ink": "#1b1f24",
    "blue": "#1f6fb4",
    "orange": "#d9730d",
    "green": "#2e8b57",
    "red": "#c0392b",
    "grey": "#8a939c",
}
"""Hex value of each colour of a chart."""

INK, BLUE, ORANGE, GREEN, RED, GREY = COLOURS.values()
GRID = "#e3e6e9"

STYLE = mpl.rc_params_from_file(Path(__file__).with_name("figure.mplstyle"), False, False)
"""Matplotlib style of all figures."""


class NotebookFigure(Figure):
    """A figure outside pyplot that notebooks display."""

    def _repr_png_(self) -> bytes:
        return png(self)


def png(figure: Figure) -> bytes:
    """Return a figure as a PNG image."""
    with io.BytesIO() as file:
        figure.savefig(file, format="png", dpi=figure.dpi)
        return file.getvalue()


def new_figure(width: float, height: float) -> Figure:
    """Return a figure of a size in inches with the common style; needs no display."""
    with mpl.rc_context(STYLE):
        figure = NotebookFigure(figsize=(width, height))
    FigureCanvasAgg(figure)  # else each measurement of a text creates a canvas
    return figure


def save(figure: Figure, directory: Path, name: str, formats: Sequence[str] = ("png",)) -> None:
    """Write the figure as ``directory/name.format`` for each format."""
    with mpl.rc_context(STYLE):
        for extension in formats:
            path = directory / f"{name}.{extension}"
            if extension == "png":
                shown, figure.dpi = figure.dpi, mpl.rcParams["savefig.dpi"]
                FigureCanvasAgg(figure).print_png(path)  # savefig draws twice
                figure.dpi = shown
            else:  # without a date, so that equal results give equal files
                metadata = {"CreationDate": None} if extension == "pdf" else None
                figure.savefig(path, metadata=metadata)


_WIDTH = 7.2  # inches, as on a printed page
_ROW = 1.9  # inches, of a row of panels of height 1
_LINE = 0.2  # inches, of a line of the title or of the legend
_SAMPLES = 1700  # per curve, for a figure of 1440 pixels
_LETTERS = 105  # in small type across a figure
_HANDLE = 11  # letters, width of the handle of a legend entry
_MARGIN = 0.06  # share of the range, left free above and below
_DASHES: dict[Dash, str] = {"solid": "-", "dashed": "--", "dotted": ":"}


def draw(chart: Chart, ax: Axes | None = None) -> Figure:
    """Return the drawing of a chart with title and legend, or draw it in place of `ax`."""
    if ax is not None:
        return _draw_in_place(ax, chart)
    title, labels = fill(chart.title, round(0.8 * _LETTERS)), _labels(chart)
    columns = _legend_columns([len(label) + _HANDLE for label in labels])
    lines = title.count("\n") + 1 - (-len(labels) // columns)
    with mpl.rc_context(STYLE):
        figure = new_figure(_WIDTH, _ROW * sum(_heights(chart)) + _LINE * lines)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10)
        _fill_grid(figure, chart)
        found: dict[str, Artist] = {}
        for axes in figure.axes:
            handles, names = axes.get_legend_handles_labels()
            found = dict(zip(names, handles, strict=True)) | found
        if labels:
            shown = [fill(label, _LETTERS - _HANDLE) for label in labels]
            handles = [found[label] for label in labels]
            figure.legend(handles, shown, loc="outside lower left", ncols=columns)
        layout = figure.get_layout_engine()
        assert layout is not None
        layout.execute(figure)
        figure.set_layout_engine("none")  # laid out once, for file and page
    return figure


drawn_once = lru_cache(maxsize=16)(draw)
"""`draw` with a cache, so that file and page share a drawing."""


def save_charts(
    charts: Iterable[Chart], directory: Path, formats: Sequence[str] = ("png",)
) -> None:
    """Write each chart as ``directory/name.format`` for each format."""
    for chart in charts:
        save(drawn_once(chart), directory, chart.name, formats)


def _rows(chart: Chart) -> list[list[tuple[int, Panel]]]:
    """Return the panels row by row, each with its first column."""
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


def _draw_in_place(ax: Axes, chart: Chart) -> Figure:
    """Draw the panels in place of `ax`, with one legend; the first panel has a title."""
    place, figure = ax.get_subplotspec(), ax.get_figure(root=True)
    if place is None or figure is None:
        raise SettingError("ax", "has no place in a grid: make it by plt.subplots")
    ax.remove()
    there = len(figure.axes)
    with mpl.rc_context(STYLE):
        _fill_grid(figure, chart, place)
        panels = figure.axes[there:]
        if not panels[0].get_title():
            panels[0].set_title(chart.title, fontsize="small", loc="left")
        labelled = [axes for axes in panels if axes.get_legend_handles_labels()[1]]
        for axes in labelled[:1]:
            axes.legend(fontsize="x-small")
    return figure


def _fill_grid(figure: Figure, chart: Chart, inside: SubplotSpec | None = None) -> None:
    """Draw the panels in a grid; only the lowest of those that share an x axis has labels."""
    rows = _rows(chart)
    divide = figure.add_gridspec if inside is None else inside.subgridspec
    grid = divide(len(rows), chart.columns, height_ratios=_heights(chart))
    above: dict[tuple[int, int], Axes] = {}
    for i, row in enumerate(rows):
        for column, panel in row:
            share = above.get((column, panel.span))
            ax = figure.add_subplot(grid[i, column : column + panel.span], sharex=share)
            _fill(ax, panel, chart.columns // panel.span)
            if share is not None:
                share.tick_params(labelbottom=False)
                share.set_xlabel("")
            above[column, panel.span] = ax


def _fill(ax: Axes, panel: Panel, per_row: int) -> None:
    """Draw a panel of a figure that has room for `per_row` panels in a row."""
    ax.margins(0.0, _MARGIN)
    for mark in panel.marks:
        _draw(ax, thinned(mark, _SAMPLES))
    _set_axis(ax, "x", panel.x, max(3, 9 // per_row))
    _set_axis(ax, "y", panel.y, 5)
    title = "\n".join(fill(line, _LETTERS // per_row) for line in panel.title.splitlines())
    ax.set_title(title, fontsize=10 if per_row == 1 else 8)


def _draw(ax: Axes, mark: Mark) -> None:
    colour, label = COLOURS[mark.colour], mark.label or "_"
    if isinstance(mark, Line):
        style = {"linestyle": _DASHES[mark.dash], "linewidth": mark.width}
        ax.plot(mark.x, mark.y, color=colour, label=label, **style)
    elif isinstance(mark, Band):
        shade = {"color": colour, "alpha": 0.25, "linewidth": 0}
        ax.fill_between(mark.x, mark.low, mark.high, label=label, **shade)
    else:
        line = ax.axhline if mark.along == "y" else ax.axvline
        line(mark.value, color=colour, label=label, linestyle=_DASHES[mark.dash], linewidth=1.0)


def _set_axis(ax: Axes, which: Literal["x", "y"], axis: Axis, labels: int) -> None:
    """Set label, scale and limits of an axis, and at most `labels` numbers on it."""
    ruler = ax.xaxis if which == "x" else ax.yaxis
    unit = axis.unit.replace("^2", "²").replace("^3", "³")
    ruler.set_label_text(f"{axis.label} ({unit})" if unit else axis.label)
    limits = axis.limits
    if axis.logarithmic:
        ax.set(**{f"{which}scale": "log"})
        ruler.set_major_formatter(ticker.FuncFormatter(lambda value, _: f"{value:g}"))
        ruler.set_minor_formatter(ticker.LogFormatter(minor_thresholds=(1, 0.5)))
    else:
        several = ticker.MaxNLocator(labels, steps=[1, 2, 2.5, 5, 10])
        ruler.set_major_locator(several if axis.step is None else ticker.MultipleLocator(axis.step))
        ruler.set_major_formatter(ticker.ScalarFormatter(useOffset=False))
    if limits is not None:
        ax.set(**{f"{which}lim": limits})


def _legend_columns(lengths: Sequence[int]) -> int:
    """Return the number of legend columns that fit the width of the figure."""
    for columns in range(len(lengths), 1, -1):
        if sum(int(part.max()) for part in np.array_split(lengths, columns)) <= _LETTERS:
            return columns
    return 1


def _labels(chart: Chart) -> list[str]:
    """Return the distinct labels of panels with several marks, for the legend."""
    found: dict[str, None] = {}
    for panel in chart.panels:
        labels = dict.fromkeys(mark.label for mark in panel.marks if mark.label)
        if len(labels) > 1:
            found |= labels
    return list(found)


_SHADES = {shade: f"var(--chart-{name})" for name, shade in COLOURS.items()}
_SHADES |= {GRID: "var(--chart-grid)", "#ffffff": "none"}
_LEFT_OUT = re.compile(
    r"<metadata>.*?</metadata>|<style.*?</style>"
    r'|(?<=<g) id="[^"]*"|(?<=<svg)[^>]*?(?= viewBox)|xlink:(?=href)|(?<=>)\s+(?=<)',
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r' (d|style|x|y|transform)="([^"]*)"')
_LONG_NUMBER = re.compile(r"-?\d+\.\d{2,}")


def chart_html(chart: Chart) -> str:
    """Return the drawing as SVG without the chart's title; its text stays text."""
    figure = drawn_once(chart)
    canvas, (heading, *_) = figure.canvas, figure.texts
    heading.set_visible(False)
    own: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": chart.name}
    with mpl.rc_context({**STYLE, **own}), io.StringIO() as file:
        FigureCanvasSVG(figure).print_svg(file, metadata={"Date": None})
        text = file.getvalue()
    heading.set_visible(True)
    figure.set_canvas(canvas)
    text = _LEFT_OUT.sub("", text[text.index("<svg") :])
    text = _ATTRIBUTE.sub(_compact, text)
    title = escape(chart.title)
    return f'<div class="chart" role="img" tabindex="0" aria-label="{title}">{text}</div>'


def _compact(attribute: re.Match[str]) -> str:
    name, value = attribute.groups()
    if name != "style":
        return f' {name}="{_LONG_NUMBER.sub(lambda one: f"{float(one[0]):.2f}", value)}"'
    pairs = (part.split(":", 1) for part in value.split(";") if ":" in part)
    named = {name.strip(): value.strip() for name, value in pairs}
    named.pop("font-family", None)
    return "".join(f' {name}="{_SHADES.get(value, value)}"' for name, value in named.items())
