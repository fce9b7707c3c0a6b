"""What a page has inside it: uPlot, which the package youplot brings, our script and our style."""

import base64
import hashlib
from functools import cache
from pathlib import Path

_HERE = Path(__file__).parent
_PARTS = ("numbers", "marks", "ranges", "figure")


@cache
def plotting_script() -> str:
    """uPlot."""
    from youplot.vendor import uplot_js

    return uplot_js()


@cache
def plotting_style() -> str:
    """The style sheet of uPlot."""
    from youplot.vendor import uplot_css

    return uplot_css()


@cache
def drawing_script() -> str:
    """uPlot and what draws a `chart_document` with it.

    It makes three functions: ``flexid.draw(element, document)`` draws into an element,
    ``flexid.update(element, document)`` shows other data there, and ``flexid.forget(element)``
    ends what is drawn there before the element is removed.
    """
    parts = [_text(f"{name}.js") for name in _PARTS]
    return "\n".join(
        (
            plotting_script(),
            "const flexid = (() => {",
            '"use strict";',
            *parts,
            "return { draw, update, forget };",
            "})();",
        )
    )


@cache
def drawing_style() -> str:
    """Style sheets of the figures: uPlot's, and ours with the colours by day and by night."""
    return plotting_style() + "\n" + _text("chart.css")


@cache
def page_script() -> str:
    """The script of a page: it draws the figures that stand in it."""
    return f"{drawing_script()}\n{_text('start.js')}"


@cache
def page_style() -> str:
    """The style sheet of a page."""
    return f"{drawing_style()}\n{_text('page.css')}"


def content_hash(text: str) -> str:
    """How a Content-Security-Policy names a script or a style sheet within a page."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def _text(name: str) -> str:
    return (_HERE / name).read_text(encoding="utf-8")
