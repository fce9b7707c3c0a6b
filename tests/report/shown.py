"""Text lines of answers, compared with ``texts/``; ``pytest --update-golden`` writes these."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from rich.text import Text
from tests.pages.page_output import agrees

import flexid
from flexid.report.chart import Axis, Chart, Level, Mark
from flexid.report.page import Answer, Command, Item, Page
from flexid.report.terminal import Table, as_text

TEXTS = Path(__file__).parent / "texts"
WIDTH = 80


def check(
    name: str, lines: Iterable[str], request: pytest.FixtureRequest, *, computed: bool = False
) -> None:
    """Assert that the lines equal those of the file of this name.

    Computed numbers must agree within the digits shown, as rounding depends on the processor.
    """
    shown = [line.replace(flexid.__version__, "VERSION") for line in lines]
    path = TEXTS / f"{name}.txt"
    if request.config.getoption("--update-golden"):
        path.write_text("\n".join(shown) + "\n", encoding="utf-8")
    wanted = path.read_text(encoding="utf-8").splitlines()
    apart = [pair for pair in zip(wanted, shown, strict=True) if pair[0] != pair[1]]
    assert [pair for pair in apart if not (computed and agrees(*pair))] == []


def page_lines(page: Page) -> Iterator[str]:
    """Yield the lines of a page."""
    yield f"{page.title} / {page.subject}"
    yield from item_lines(page.lead)
    yield from answer_lines(page.answers)
    for section in page.sections:
        yield f"## {section.name}: {section.title}"
        for item in section.content:
            yield from item_lines(item)


def answer_lines(answers: Iterable[Answer]) -> Iterator[str]:
    """Yield the lines of questions with their answers."""
    for answer in answers:
        yield f"? {answer.question} {answer.word} ({answer.tone})"
        for item in answer.content:
            yield from item_lines(item)


def item_lines(item: Item) -> Iterator[str]:
    """Yield the lines of one item of a page."""
    match item:
        case Table() | Text() | str():
            yield from as_text([item], WIDTH).splitlines()
        case Chart():
            yield f"figure {item.name}: {item.says}"
        case Command(text):
            yield f"$ {text}"


def chart_lines(chart: Chart) -> Iterator[str]:
    """Yield axes of a chart, and of each mark the first, last and largest value, and the mean."""
    yield f"# {chart.name}: {chart.title}"
    yield chart.says
    for panel in chart.panels:
        yield f"{panel.title!r} over {axis_text(panel.x)}, {axis_text(panel.y)}"
        yield from (
            f"  {type(mark).__name__} {mark.label!r} {values_text(mark)}" for mark in panel.marks
        )


def axis_text(axis: Axis) -> str:
    """Return an axis with its unit, and with its limits if any."""
    limits = axis.limits and tuple(f"{end:.3e}" for end in axis.limits)
    return " ".join([axis.label, axis.unit, *(limits or ())])


def values_text(mark: Mark) -> str:
    """Return the values of a mark, with rounding errors as zero."""
    if isinstance(mark, Level):
        return f"{mark.along} = {mark.value:.3e}"
    found = []
    for name in ("x", "y", "low", "high"):
        values = getattr(mark, name, np.empty(0))
        own = values[np.isfinite(values)]
        if len(own):
            largest = np.abs(own).max()
            of_all = (own[0], own[-1], largest, np.abs(own).mean())
            found.append(", ".join(f"{v * (abs(v) > 1e-9 * largest):.3e}" for v in of_all))
    return f"{len(mark.x)}: {'; '.join(found)}"
