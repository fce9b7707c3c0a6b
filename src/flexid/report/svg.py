"""A chart as SVG that stands in a page: its colours are those of the page, by day and by night.

A page with a strict policy allows no style of an element, so that what Matplotlib writes there
becomes attributes; numbers lose digits that nobody could see.
"""

import io
import re
from html import escape
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_svg import FigureCanvasSVG

from flexid.report.chart import Chart
from flexid.report.figure import COLOURS, GRID, STYLE, drawn_once

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
    """The drawing without the chart's title, in which text is text."""
    figure = drawn_once(chart)
    canvas, (heading, *_) = figure.canvas, figure.texts
    heading.set_visible(False)
    own: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": chart.name}
    with mpl.rc_context({**STYLE, **own}), io.StringIO() as file:
        FigureCanvasSVG(figure).print_svg(file, metadata={"Date": None})  # savefig draws twice
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
