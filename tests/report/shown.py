"""What an answer shows, as lines that stand in ``texts/``; ``pytest --update-golden`` writes it."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from rich.text import Text

import flexid
from flexid.report.chart import Chart
from flexid.report.page import Answer, Command, Item, Page
from flexid.report.terminal import Table, as_text

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
    yield f"{page.title} / {page.subject}"
    yield from item_lines(page.lead)
    yield from answer_lines(page.answers)
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
            yield from as_text([item], WIDTH).splitlines()
        case Chart():
            yield f"figure {item.name}: {item.says}"
        case Command(text):
            yield f"$ {text}"
