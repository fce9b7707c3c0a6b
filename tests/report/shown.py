"""What an answer shows, as lines that stand in ``texts/``; ``pytest --update-golden`` writes it."""

from collections.abc import Iterable, Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from rich.text import Text

import flexid
from flexid.arrays import FloatArray
from flexid.report.chart import Axis, Chart, Level, Mark
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
        case Table() | Text() | str():
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
    """A chart: its words, axes, and the marks of each panel with what they span."""
    yield f"figure {chart.name}: {chart.title}"
    yield chart.says
    for panel in chart.panels:
        yield f"| {' / '.join(panel.title.splitlines())} ({panel.colour})"
        yield f"|   over {_axis(panel.x)}: {_axis(panel.y)}"
        yield from (f"|   {_mark(mark)}" for mark in panel.marks)


def _axis(axis: Axis) -> str:
    logarithmic = " logarithmic" if axis.logarithmic else ""
    limits = "" if axis.limits is None else " {:.4g} to {:.4g}".format(*axis.limits)
    return f"{axis.label} ({axis.unit}){logarithmic}{limits} {', '.join(axis.categories)}".strip()


def _mark(mark: Mark) -> str:
    said = f"{type(mark).__name__.lower()} {mark.colour} {getattr(mark, 'dash', '')}"
    said += f" {mark.label!r}"
    if isinstance(mark, Level):
        return f"{said} {mark.along} = {mark.value:.4g}"
    arrays = {f.name: getattr(mark, f.name) for f in fields(mark)}
    spans = (_span(name, a) for name, a in arrays.items() if isinstance(a, np.ndarray))
    flags = [name for name in ("filled", "faint", "stems") if arrays.get(name)]
    return " ".join([said, *spans, *flags])


def _span(name: str, values: FloatArray) -> str:
    """Number of values, the first, the ends of all, and the last; and how many there are not."""
    known = values[np.isfinite(values)]
    lost = f", {len(values) - len(known)} lost" if len(known) < len(values) else ""
    if not len(known):
        return f"{name}[{len(values)}{lost}]"
    several = np.round((known[0], known.min(), known.max(), known[-1]), 12) + 0.0
    return f"{name}[{len(values)}{lost}] " + " ".join(f"{x:.4g}" for x in several)
