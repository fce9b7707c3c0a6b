"""A page as one HTML file, in which everything from outside is text and nothing is fetched."""

from __future__ import annotations

import base64
import hashlib
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import flexid
from flexid.report.charts.description import Chart
from flexid.report.charts.svg import chart_html
from flexid.report.page.layout import Bullets, Command, Facts, Folded, Link, Page, Warned
from flexid.report.style import GREEN, ORANGE, RED
from flexid.report.terminal import Table

if TYPE_CHECKING:
    from jinja2 import BaseLoader, Environment

NAME = "report.html"

_HERE = Path(__file__).parent

_TONES = {
    **dict.fromkeys(("green", GREEN), "good"),
    **dict.fromkeys(("yellow", ORANGE), "fair"),
    **dict.fromkeys(("red", RED), "bad"),
}
_TESTS = {
    "table_part": Table,
    "chart": Chart,
    "folded": Folded,
    "command": Command,
    "points": Bullets,
    "facts": Facts,
    "link": Link,
    "warning": Warned,
}


def page_html(page: Page) -> str:
    """A whole document, with style and figures inside.

    Its Content-Security-Policy allows no request, no script, and no style but its own.
    """
    from markupsafe import Markup

    style = _page_style()
    return (
        _environment()
        .get_template("page.html")
        .render(
            page=page,
            version=flexid.__version__,
            style=Markup(style),
            style_hash=Markup(_content_hash(style)),
        )
    )


def save_page(page: Page, directory: Path) -> None:
    """Write a page as ``directory/report.html``."""
    (directory / NAME).write_text(page_html(page), encoding="utf-8")


@cache
def _environment() -> Environment:
    from jinja2 import FileSystemLoader
    from markupsafe import Markup

    environment = page_environment(FileSystemLoader(_HERE / "templates"))
    environment.filters["drawn"] = lambda chart: Markup(chart_html(chart))
    return environment


def page_environment(loader: BaseLoader) -> Environment:
    """Templates that escape what they are given, tell a page's items apart and typeset them."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.tests.update(
        {name: lambda item, kind=kind: isinstance(item, kind) for name, kind in _TESTS.items()}
    )
    environment.filters["typeset"] = lambda text: text.replace("^2", "²").replace("^3", "³")
    environment.filters["breakable"] = breakable
    environment.filters["tone"] = lambda style: _TONES.get(str(style), "")
    return environment


def breakable(name: str) -> Any:
    """A name that may go on in the next line after each underscore."""
    from markupsafe import Markup, escape

    return Markup("<wbr>").join(map(escape, re.split("(?<=_)", name)))


@cache
def drawing_style() -> str:
    """The style sheet of figures, with the colours by day and by night."""
    return (_HERE / "chart.css").read_text(encoding="utf-8")


@cache
def _page_style() -> str:
    """The style sheet of a page."""
    page = (_HERE / "page.css").read_text(encoding="utf-8")
    return f"{drawing_style()}\n{page}"


def _content_hash(text: str) -> str:
    """How a Content-Security-Policy names a script or a style sheet within a page."""
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"
