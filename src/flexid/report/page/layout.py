"""What a page is made of, apart from how it looks: an answer first, then sections."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from flexid.report.charts.description import Chart
from flexid.report.terminal import Part, Table

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
    content: "Sequence[Item]"  # what it holds


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
