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
class Points:
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
    """A way to another section of the page.

    Parameters
    ----------
    text : str
        What it says.
    section : str
        The section's name.
    """

    text: str
    section: str


@dataclass(frozen=True)
class Folded:
    """What is shown when asked for.

    Parameters
    ----------
    summary : str
        What it is.
    content : sequence
        What it holds.
    """

    summary: str
    content: "Sequence[Item]"


Item = Part | Chart | Command | Points | Facts | Warned | Link | Folded


def drawn(charts: Sequence[Chart], name: str) -> list[Chart]:
    """The chart of a name, where there is one."""
    return [chart for chart in charts if chart.name == name]


@dataclass(frozen=True)
class Answer:
    """An answer to a question that a reader has at first.

    Parameters
    ----------
    question : str
        The question.
    word : str
        The answer in a word or two.
    tone : {"", "good", "fair", "bad"}
        What that means.
    content : sequence
        What it rests on.
    """

    question: str
    word: str
    tone: Tone
    content: Sequence[Item]


@dataclass(frozen=True)
class Section:
    """A part of a page with a heading.

    Parameters
    ----------
    name : str
        Its address within the page.
    title : str
        Its heading.
    content : sequence
        What it holds.
    """

    name: str
    title: str
    content: Sequence[Item]


@dataclass(frozen=True)
class Page:
    """A page of an answer.

    Parameters
    ----------
    kind : str
        What was done: "identification".
    title : str
        What of.
    subject : str
        What from.
    lead : Table
        The table that one looks for.
    answers : sequence of Answer
        To what one asks next.
    sections : sequence of Section
        All else.
    notes : sequence of str
        What the words of the table mean.
    """

    kind: str
    title: str
    subject: str
    lead: Table
    answers: Sequence[Answer]
    sections: Sequence[Section]
    notes: Sequence[str] = field(default_factory=tuple)
