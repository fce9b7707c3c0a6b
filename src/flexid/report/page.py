"""A page: what a terminal prints, with figures; one HTML file in which nothing is fetched."""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from math import log10
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rich.text import Text

import flexid
from flexid.report.chart import Chart
from flexid.report.terminal import Column, Part, Table

if TYPE_CHECKING:
    from jinja2 import Environment


Tone = Literal["", "good", "fair", "bad"]
"""What a word means for whoever reads it; shown as a sign and a colour."""


@dataclass(frozen=True)
class Command:
    """A line for a terminal."""

    text: str


Item = Part | Chart | Command


@dataclass(frozen=True)
class Answer:
    """An answer to a question that a reader has at first."""

    question: str  # the question
    word: str  # the answer in a word or two
    tone: Tone  # what that means
    content: Sequence[str | Command]  # what it rests on


@dataclass(frozen=True)
class Section:
    """A part of a page with a heading."""

    name: str  # its address within the page
    title: str  # its heading
    content: Sequence[Item]  # what it holds


@dataclass(frozen=True)
class Page:
    """A page of an answer."""

    title: str  # what of
    subject: str  # what from
    lead: Table  # the table that one looks for
    answers: Sequence[Answer]  # to what one asks next
    sections: Sequence[Section]  # all else


@dataclass(frozen=True)
class Presenter:
    """What there is to show of a kind of result; each function takes the result first."""

    heading: Callable[..., tuple[str, str]]  # what it is, and what it was made from
    parts: Callable[..., Iterable[Part]]  # tables and sentences
    document: Callable[..., Mapping[str, Any]]  # everything but the time series, for JSON
    charts: Callable[..., Sequence[Chart]] = lambda *_: ()  # the most important one first
    answers: Callable[..., Sequence[Answer]] = lambda *_: ()  # on a page, next to the first table
    evidence: Callable[..., Iterable[Part]] = lambda *_: ()  # what choices rest on
    write_data: Callable[..., None] = lambda *_: None  # into a folder; whether as CSV, too

    def page(
        self, shown: Sequence[Any], charts: Sequence[Chart], warnings: Sequence[str], command: str
    ) -> Page:
        """All that is printed of a result, with its charts and how to repeat it."""
        parts = [*self.parts(*shown)]
        lead = next(part for part in parts if isinstance(part, Table))
        rest = [part for part in parts if part is not lead]
        facts = _facts(self.document(*shown).get("provenance", {}))
        origin: list[Item] = [Command(command)] if command else []
        origin += [facts] if facts.rows else []
        sections = (
            Section("warnings", "Warnings", [Text(warning, "yellow") for warning in warnings]),
            Section("numbers", "In numbers and sentences", rest),
            *(Section(chart.name, chart.title, [chart]) for chart in charts),
            Section("evidence", "The evidence behind every choice", [*self.evidence(*shown)]),
            Section("origin", "How to repeat it", origin),
        )
        title, subject = self.heading(*shown)
        filled = [section for section in sections if section.content]
        return Page(title, subject, lead, self.answers(*shown), filled)


def logs_of(provenance: Mapping[str, Any]) -> str:
    """Names of the files that a result was made from."""
    logs = provenance.get("inputs", ())
    files = [Path(log["file"]).name for log in logs if log.get("file")]
    return ", ".join(files) or "data in memory"


def _facts(provenance: Mapping[str, Any]) -> Table:
    """Versions, logs with their digests, settings and choices."""
    table = Table("Provenance", (Column("what"), Column("value")))
    for name, value in _flat(provenance):
        table.add(name, value)
    return table


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, str]]:
    """Names with values of what lies within each other; what is not there is left out."""
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
    """A whole document with style and figures inside; it allows no request and no script."""
    from markupsafe import Markup

    own = (_HERE / "page.css").read_text(encoding="utf-8")
    style = f"{drawing_style()}\n{own}"
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    template = page_environment().get_template("page.html")
    content = {"style": Markup(style), "style_hash": Markup(f"'sha256-{digest}'")}
    return template.render(page=page, version=flexid.__version__, **content)


@cache
def page_environment(folder: Path = _HERE) -> Environment:
    """Templates that escape what they are given, name a page's items and typeset them."""
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
    """A name that may go on in the next line after each underscore."""
    from markupsafe import Markup, escape

    return Markup("<wbr>").join(map(escape, re.split("(?<=_)", str(name))))


@cache
def drawing_style() -> str:
    """The style sheet of figures, with the colours by day and by night."""
    return (_HERE / "chart.css").read_text(encoding="utf-8")
