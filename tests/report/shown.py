"""What an answer shows, as lines that stand in ``texts/``; ``pytest --update-golden`` writes it."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from rich.text import Text

import flexid
from flexid.report.chart import Axis, Chart
from flexid.report.page import Answer, Bullets, Command, Facts, Folded, Item, Link, Page, Warned
from flexid.report.terminal import Table, laid_out

TEXTS = Path(__file__).parent / "texts"
WIDTH = 80


def check(name: str, lines: Iterable[str], request: pytest.FixtureRequest) -> None:
    """Assert that what is shown is what stands in the file of that name."""
    shown = [line.replace(flexid.__version__, "VERSION") for line in lines]
    path = TEXTS / f"{name}.txt"
    if request.config.getoption("--update-golden"):
        path.write_text("\n".join(shown) + "\n", encoding="utf-8")
    assert shown == path.read_text(encoding="utf-8").splitlines()


def page_lines(page: Page) -> Iterator[str]:
    """All of a page."""
    yield f"{page.kind}: {page.title} / {page.subject}"
    yield from item_lines(page.lead)
    yield from answer_lines(page.answers)
    yield from page.notes
    for section in page.sections:
        yield f"## {section.name}: {section.title}"
        for item in section.content:
            yield from item_lines(item)


def answer_lines(answers: Iterable[Answer]) -> Iterator[str]:
    """Questions with their answers."""
    for answer in answers:
        yield f"? {answer.question} {answer.word} ({answer.tone})"
        for item in answer.content:
            yield from item_lines(item)


def item_lines(item: Item) -> Iterator[str]:
    """One item of a page."""
    match item:
        case Table() | Text():
            yield from (line.plain for line in laid_out([item], WIDTH))
        case Chart():
            yield from chart_lines(item)
        case Command(text):
            yield f"$ {text}"
        case Bullets(lines):
            yield from (f"- {line}" for line in lines)
        case Facts(entries):
            yield from (f"{name}: {value}" for name, value in entries)
        case Warned(text):
            yield f"! {text}"
        case Link(text, section):
            yield f"-> {section}: {text}"
        case Folded(summary, content):
            yield f"+ {summary}"
            for inner in content:
                yield from item_lines(inner)


def chart_lines(chart: Chart) -> Iterator[str]:
    """A chart but for its numbers: words, axes, and the marks of each panel."""
    yield f"figure {chart.name}: {chart.title}"
    yield chart.says
    for panel in chart.panels:
        yield f"| {' / '.join(panel.title.splitlines())} | {_axis(panel.x)} | {_axis(panel.y)}"
        for mark in panel.marks:
            yield f"|   {type(mark).__name__.lower()} {mark.colour}: {mark.label}".rstrip(": ")


def _axis(axis: Axis) -> str:
    logarithmic = ", logarithmic" if axis.logarithmic else ""
    return f"{axis.label} ({axis.unit}){logarithmic}" + " ".join(axis.categories)
