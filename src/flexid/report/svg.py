"""A chart as SVG that stands in a page: its colours are those of the page, by day and by night.

A page with a strict policy allows no style of an element, so that what Matplotlib writes there
becomes attributes; numbers lose digits that nobody could see.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG

from flexid.report.chart import Chart
from flexid.report.figure import COLOURS, GRID, NARROW, STYLE, WIDTH, drawn_once

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

_SHADES = {shade: f"var(--chart-{name})" for name, shade in COLOURS.items()}
_SHADES |= {GRID: "var(--chart-grid)", "#ffffff": "none"}
_LEFT_OUT = re.compile(r"<metadata>.*?</metadata>|<style.*?</style>|(?<=>)\s+(?=<)", re.DOTALL)
_TAG = re.compile(r"<[^>]*>")
_OWN_NAME = re.compile(r'(?<=<g) id="[^"]*"|(?<=<svg).*?(?= viewBox)|(?<=<use )xlink:(?=href)')
_ATTRIBUTE = re.compile(r' (d|style|x|y|transform)="([^"]*)"')
_LONG_NUMBER = re.compile(r"-?\d+\.\d{2,}")
_MARKERS = re.compile(
    r'<g([^>]*)>(<use href="[^"]*" x="[^"]*" y="[^"]*"([^>]*)/>(?:<use[^>]*\3/>)*)</g>'
)
_COMMAND = re.compile(r"\s*([MLCQz]|$)\s*")


def chart_svg(chart: Chart, width: float = WIDTH) -> str:
    """An ``<svg>`` element without the chart's title, in which text is text."""
    figure = drawn_once(chart, width)
    canvas, (title, *_) = figure.canvas, figure.texts
    title.set_visible(False)
    own: dict[RcKeyType, Any] = {"svg.fonttype": "none", "svg.hashsalt": f"{chart.name} {width}"}
    with mpl.rc_context({**STYLE, **own}), io.StringIO() as file:
        FigureCanvasSVG(figure).print_svg(file, metadata={"Date": None})  # savefig draws twice
        text = file.getvalue()
    title.set_visible(True)
    figure.set_canvas(canvas)
    text = _TAG.sub(_compact, _LEFT_OUT.sub("", text[text.index("<svg") :]))
    # A group of alike markers says their look once
    return _MARKERS.sub(lambda m: f"<g{m[1]}{m[3]}>{m[2].replace(m[3], '')}</g>", text)


_WIDTHS = {"wide": WIDTH, "narrow": NARROW}


def chart_html(chart: Chart, windows: Iterable[str] = ("wide", "narrow")) -> str:
    """The drawing for each kind of window; a page with several shows the one that fits."""
    kinds, title = [*windows], escape(chart.title)
    only = "only " if len(kinds) == 1 else ""
    return "".join(
        f'<div class="chart {only}{kind}" role="img" aria-label="{title}">'
        f"{chart_svg(chart, _WIDTHS[kind])}</div>"
        for kind in kinds
    )


@dataclass(frozen=True)
class Drawn:
    """A chart as the studio shows it."""

    title: str
    says: str
    html: str


def drawn(chart: Chart, windows: Iterable[str] = ("wide", "narrow")) -> Drawn:
    """A chart, drawn for the studio."""
    return Drawn(chart.title, chart.says, chart_html(chart, windows))


def _compact(tag: re.Match[str]) -> str:
    """A tag without names and styles; a marker, which many points use, keeps its digits."""
    text = _OWN_NAME.sub("", tag[0])
    digits = 2 if text.startswith("<path id") else 1

    def rounded(numbers: str) -> str:
        return _LONG_NUMBER.sub(lambda one: f"{round(float(one[0]), digits):g}", numbers)

    def attribute(found: re.Match[str]) -> str:
        name, value = found.groups()
        if name == "style":
            return _attributes(value)
        value = rounded(value)
        if name == "d":
            value = _COMMAND.sub(r"\1", value)
            if not {"C", "Q"} & {*value}:
                value = value.replace("L", " ")  # a point ends a line
        return f' {name}="{value}"'

    return _ATTRIBUTE.sub(attribute, text)


def _attributes(style: str) -> str:
    pairs = (part.split(":", 1) for part in style.split(";") if ":" in part)
    named = {name.strip(): value.strip() for name, value in pairs}
    named.pop("font-family", None)
    return "".join(f' {name}="{_SHADES.get(value, value)}"' for name, value in named.items())
