"""The report page: the terminal's output with figures, as one self-contained HTML file."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.text import Text

import flexid
from flexid.report.chart import Chart
from flexid.report.terminal import Part, Table

if TYPE_CHECKING:
    from jinja2 import Environment


Tone = Literal["", "good", "fair", "bad"]
"""Rating of an answer, shown as a sign and a colour."""


@dataclass(frozen=True)
class Command:
    """A command line to type in a terminal."""

    text: str


Item = Part | Chart | Command


@dataclass(frozen=True)
class Answer:
    """An answer to a question of the reader, at the top of the page."""

    question: str
    word: str  # short answer
    tone: Tone  # rating of the answer
    content: Sequence[str | Command]  # sentences and commands below the answer


@dataclass(frozen=True)
class Section:
    """A part of a page with a heading."""

    name: str  # anchor within the page
    title: str  # heading
    content: Sequence[Item]  # tables, sentences and figures


@dataclass(frozen=True)
class Page:
    """Content of a report page."""

    title: str  # kind of the result
    subject: str  # source of the result, such as its logs
    lead: Table  # main table
    answers: Sequence[Answer]  # next to the main table
    sections: Sequence[Section]  # everything else


def result_page(
    present: Callable[[str], Any],  # gives what a function of the report's module returns, by name
    charts: Sequence[Chart],
    warnings: Sequence[str],
    provenance: Mapping[str, Any],
    command: str,  # command line that repeats the result
) -> Page:
    """Return a page with the printed result, its charts, and the command that repeats it."""
    parts = [*present("parts")]
    lead = next(part for part in parts if isinstance(part, Table))
    rest = [part for part in parts if part is not lead]
    facts = Table("Provenance", ("item", "value"), _flat(provenance))
    origin: list[Item] = [Command(command)] if command else []
    origin += [facts] if facts.rows else []
    sections = (
        Section("warnings", "Warnings", [Text(warning, "yellow") for warning in warnings]),
        Section("numbers", "All other results", rest),
        *(Section(chart.name, chart.title, [chart]) for chart in charts),
        Section("evidence", "Evidence for every choice", [*present("evidence")]),
        Section("origin", "How to repeat this result", origin),
    )
    filled = [section for section in sections if section.content]
    title, subject = present("heading")
    return Page(title, subject, lead, present("answers"), filled)


def logs_of(provenance: Mapping[str, Any]) -> str:
    """Return the names of the logs of a result."""
    logs = provenance.get("inputs", ())
    files = [Path(log["file"]).name for log in logs if log.get("file")]
    return ", ".join(files) or "data in memory"


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Return names and values of nested mappings, flattened and without empty values."""
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from _flat(part, f"{name} {key}".strip())
    elif isinstance(value, list | tuple) and any(isinstance(part, Mapping) for part in value):
        for part in value:
            yield from _flat(part, name)
    elif isinstance(value, list | tuple):
        yield name, ", ".join(map(str, value))
    elif value not in (None, "", "auto"):
        yield name, f"{value:.10g}" if isinstance(value, float) else str(value)


NAME = "report.html"

_HERE = Path(__file__).parent

_TONES = {"green": "good", "yellow": "fair", "red": "bad"}


def page_html(page: Page) -> str:
    """Return an HTML document with style and figures, which allows no request and no script."""
    from markupsafe import Markup

    own = (_HERE / "page.css").read_text(encoding="utf-8")
    style = f"{drawing_style()}\n{own}"
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    template = page_environment().get_template("page.html")
    content = {"style": Markup(style), "style_hash": Markup(f"'sha256-{digest}'")}
    return template.render(page=page, version=flexid.__version__, **content)


@cache
def page_environment(folder: Path = _HERE) -> Environment:
    """Return the template environment: autoescaping, with filters for the items of a page."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined
    from markupsafe import Markup

    from flexid.report.figure import chart_html

    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["drawn"] = lambda chart: Markup(chart_html(chart))
    environment.filters["kind"] = lambda item: type(item).__name__
    environment.filters["typeset"] = lambda text: str(text).replace("^2", "²").replace("^3", "³")
    environment.filters["log10"] = log10
    environment.filters["breakable"] = breakable
    environment.filters["tone"] = lambda style: _TONES.get(str(style), "")
    return environment


def breakable(name: str) -> Any:
    """Return a name that may wrap after each underscore."""
    from markupsafe import Markup, escape

    return Markup("<wbr>").join(map(escape, re.split("(?<=_)", str(name))))


@cache
def drawing_style() -> str:
    """Return the style sheet of figures, with the colours of light and dark mode."""
    return (_HERE / "chart.css").read_text(encoding="utf-8")
