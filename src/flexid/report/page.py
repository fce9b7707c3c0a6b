"""A page: an answer first, then sections; one HTML file in which nothing is fetched.

Everything from outside is text.
"""

from __future__ import annotations

import base64
import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import flexid
from flexid.report.chart import Chart
from flexid.report.terminal import Part, Table

if TYPE_CHECKING:
    from jinja2 import BaseLoader, Environment


Tone = Literal["", "good", "fair", "bad"]
"""What a word means for whoever reads it; shown as a sign and a colour."""


@dataclass(frozen=True)
class Command:
    """A line for a terminal."""

    text: str


@dataclass(frozen=True)
class Bullets:
    """Sentences below each other."""

    lines: Sequence[str]


@dataclass(frozen=True)
class Facts:
    """Names with what they stand for."""

    entries: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Warned:
    """What one should know before trusting the numbers."""

    text: str


@dataclass(frozen=True)
class Link:
    """A way to another section of the page."""

    text: str  # what it says
    section: str  # the section's name


@dataclass(frozen=True)
class Folded:
    """What is shown when asked for."""

    summary: str  # what it is
    content: Sequence[Item]  # what it holds


Item = Part | Chart | Command | Bullets | Facts | Warned | Link | Folded


def drawn(charts: Sequence[Chart], name: str) -> list[Chart]:
    """The chart of a name, where there is one."""
    return [chart for chart in charts if chart.name == name]


@dataclass(frozen=True)
class Answer:
    """An answer to a question that a reader has at first."""

    question: str  # the question
    word: str  # the answer in a word or two
    tone: Tone  # what that means
    content: Sequence[Item]  # what it rests on


@dataclass(frozen=True)
class Section:
    """A part of a page with a heading."""

    name: str  # its address within the page
    title: str  # its heading
    content: Sequence[Item]  # what it holds


@dataclass(frozen=True)
class Page:
    """A page of an answer."""

    kind: str  # what was done: "identification"
    title: str  # what of
    subject: str  # what from
    lead: Table  # the table that one looks for
    answers: Sequence[Answer]  # to what one asks next
    sections: Sequence[Section]  # all else
    notes: Sequence[str] = field(default_factory=tuple)  # what the words of the table mean


@dataclass(frozen=True)
class Presenter:
    """What there is to show of a kind of result; each function takes the result first."""

    parts: Callable[..., Iterable[Part]]  # tables and sentences
    document: Callable[..., Mapping[str, Any]]  # everything but the time series, for JSON
    charts: Callable[..., Sequence[Chart]] = lambda *_: ()  # the most important one first
    page: Callable[..., Page] | None = None  # takes the charts, the command and its folder too
    evidence: Callable[..., Iterable[Part]] = lambda *_: ()  # what choices rest on
    write_data: Callable[..., None] = lambda *_: None  # into a folder; whether as CSV, too


def sections_of(
    warnings: Sequence[str],
    sections: Iterable[Section],
    command: str,
    facts: Iterable[tuple[str, str]] = (),
    remarks: Sequence[str] = (),
) -> list[Section]:
    """All sections but the empty ones: warnings first, and how to repeat it last."""
    origin: list[Item] = [Command(command)] if command else []
    origin += [*remarks]
    entries = [*facts]
    if entries:
        origin.append(Facts(entries))
    every = (
        Section("warnings", "Warnings", [*map(Warned, warnings)]),
        *sections,
        Section("origin", "How to repeat it", origin),
    )
    return [section for section in every if section.content]


NAME = "report.html"

_HERE = Path(__file__).parent

_TONES = {"green": "good", "yellow": "fair", "red": "bad"}


def page_html(page: Page) -> str:
    """A whole document, with style and figures inside.

    Its Content-Security-Policy allows no request, no script, and no style but its own.
    """
    from markupsafe import Markup

    own = (_HERE / "page.css").read_text(encoding="utf-8")
    style = f"{drawing_style()}\n{own}"
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    template = _environment().get_template("page.html")
    content = {"style": Markup(style), "style_hash": Markup(f"'sha256-{digest}'")}
    return template.render(page=page, version=flexid.__version__, **content)


def save_page(page: Page, directory: Path) -> None:
    """Write a page as ``directory/report.html``."""
    (directory / NAME).write_text(page_html(page), encoding="utf-8")


@cache
def _environment() -> Environment:
    from jinja2 import FileSystemLoader
    from markupsafe import Markup

    from flexid.report.svg import chart_html

    environment = page_environment(FileSystemLoader(_HERE / "templates"))
    environment.filters["drawn"] = lambda chart: Markup(chart_html(chart))
    return environment


def page_environment(loader: BaseLoader) -> Environment:
    """Templates that escape what they are given, name a page's items and typeset them."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["kind"] = lambda item: type(item).__name__
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
