"""Output on a terminal: sentences, and tables that never cut a number."""

import io
import re
import sys
from collections.abc import Iterable, Sequence
from math import floor, inf, isfinite, isnan, log10
from typing import NamedTuple

from rich import box
from rich.cells import cell_len
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text

from flexid.identification.vocabulary.evidence import Verdict

WIDEST = 100  # columns at most; longer lines are hard to read

_BETWEEN = 2  # blanks between two columns
_EMPTY = Text()


class Column(NamedTuple):
    """A column of a table."""

    heading: str
    right: bool = False  # right-aligned, as numbers are
    whole: bool = False  # cells are never wrapped, as with units


UNIT = Column("unit", whole=True)


def numbers(*headings: str) -> tuple[Column, ...]:
    """Return right-aligned columns."""
    return tuple(Column(heading, right=True) for heading in headings)


class Table:
    """A table, which wraps words and parts of names if it is too wide."""

    def __init__(
        self,
        title: str,
        columns: Iterable[Column | str],  # the first one names the rows; a text is a heading
        rows: Iterable[Iterable[Text | str]] = (),
    ) -> None:
        self.title = title
        self.columns = [Column(one) if isinstance(one, str) else one for one in columns]
        self.rows: list[list[Text]] = []
        for row in rows:
            self.add(*row)

    def add(self, *cells: Text | str) -> None:
        """Add a row; missing cells at its end are empty."""
        texts = [Text(cell) if isinstance(cell, str) else cell for cell in cells]
        self.rows.append(texts + [Text()] * (len(self.columns) - len(texts)))

    def drawn(self, width: int) -> Grid:
        """Return the table within `width` columns, or as wide as its numbers and words need."""
        grid = Grid(
            box=box.SIMPLE_HEAD,
            show_edge=False,
            pad_edge=False,
            padding=(0, _BETWEEN - 1, 0, 0),
            header_style="",
        )
        widths = self._widths(width)
        for column, own in zip(self.columns, widths, strict=True):
            justify = "right" if column.right else "left"
            grid.add_column(column.heading, justify=justify, width=own, overflow="fold")
        for name, *cells in self.rows:
            grid.add_row(_broken(name, widths[0]), *cells)
        grid.width = sum(widths) + _BETWEEN * (len(widths) - 1)
        return grid

    def _widths(self, width: int) -> list[int]:
        """Return column widths; the column with most slack shrinks first, and numbers last."""
        widths, slack = [], []
        for place, column in enumerate(self.columns):
            texts = [column.heading, *(row[place].plain for row in self.rows)]
            parts = texts if column.whole else [p for t in texts for p in _parts(t, name=not place)]
            widths.append(max(map(cell_len, texts)))
            slack.append(widths[-1] - max(map(cell_len, parts), default=0))
        over = sum(widths) + _BETWEEN * (len(widths) - 1) - width
        for place in sorted(range(len(widths)), key=lambda p: (self.columns[p].right, -slack[p])):
            taken = min(slack[place], max(over, 0))
            widths[place] -= taken
            over -= taken
        return widths


def _parts(text: str, *, name: bool) -> list[str]:
    """Return the unbreakable parts of a text: words, and parts of names up to underscores."""
    return [part.rstrip() for part in re.split(r"(?<=[ _])" if name else r"(?<= )", text)]


def _broken(name: Text, width: int) -> Text:
    """Return a name wrapped to a width after its underscores."""
    lines = [""]
    for part in re.split(r"(?<=[ _])", name.plain):
        if cell_len(lines[-1] + part.rstrip()) > width and lines[-1]:
            lines.append("")
        lines[-1] += part
    return Text("\n".join(lines), name.style) if len(lines) > 1 else name


Part = Table | Text | str  # a table or a sentence; a `Text` has a style


def number(value: float, digits: int, unit: str = "") -> str:
    """Return a number as text, with `digits` significant digits and its unit."""
    text = f"{value:.{digits}g}"
    if "e+0" in text and abs(value) < 1e6:  # no power of ten for up to six digits
        text = f"{float(text):.0f}"
    return f"{text} {unit}" if unit else text


def format_fit(fit: float) -> str:
    """Return a free-run fit as text."""
    if isnan(fit):
        return "not tested (at rest)"
    return f"{fit:.1f} %" if fit > -1000.0 else "diverges"


def laid_out(parts: Iterable[Part], width: int) -> Group:
    """Return the layout of sentences, and of tables with an empty line below each."""
    drawn: list[RenderableType] = []
    for part in parts:
        if isinstance(part, Table):
            drawn += [Text(part.title, "bold"), part.drawn(width), _EMPTY]
            continue
        text = part if isinstance(part, Text) else Text(part)
        indent = len(text.plain) - len(text.plain.lstrip())
        if text.plain:
            drawn.append(Padding(Text(text.plain.strip(), text.style), (0, 0, 0, indent)))
        elif drawn and drawn[-1] is not _EMPTY:
            drawn.append(_EMPTY)
    return Group(*drawn)


def as_text(parts: Iterable[Part], width: int = WIDEST) -> str:
    """Return tables and sentences as lines of text, without colour."""
    with io.StringIO() as file:
        console = Console(file=file, width=width, color_system=None, highlight=False)
        console.print(laid_out(parts, width), soft_wrap=False, crop=False)
        lines = [line.rstrip() for line in file.getvalue().splitlines()]
    return "\n".join(lines).rstrip("\n")


def print_parts(parts: Iterable[Part]) -> None:
    """Print tables and sentences on standard output."""
    console = Console(highlight=False)
    width = min(console.width, WIDEST)
    if console.is_terminal:
        console.print(laid_out(parts, width), width=width, crop=False)
    else:
        print(as_text(parts, width))
    sys.stdout.flush()  # so that a write error is raised here, and not at exit


_MOST = 15  # significant digits that a float can represent


def format_with_interval(value: float, lower: float, upper: float) -> tuple[str, str, str]:
    """Return numbers as text, to two digits of the width of their interval."""
    numbers = (value, lower, upper)
    width = upper - lower
    if isnan(width) or not isfinite(value) or width < 0.0 or width == inf:
        first, second, third = ("–" if isnan(x) else number(x, 1) for x in numbers)
    elif width == 0.0:
        first, second, third = (f"{x:.6g}" for x in numbers)
    else:
        largest = max(map(abs, numbers))
        place = max(floor(log10(width)) - 1, floor(log10(largest)) - _MOST + 1)
        if lower < 0.0 < upper and abs(value) < 0.5 * 10.0**place:
            numbers = (0.0, lower, upper)  # digits below the interval's resolution mean nothing
        first, second, third = _rounded(numbers, place)
    return first, second, third


def _rounded(numbers: Sequence[float], place: int) -> tuple[str, ...]:
    """Return numbers rounded at a power of ten; all scientific if that is shorter."""
    scientific = tuple(_scientific(x, place) for x in numbers)
    usual = tuple(
        f"{x:.{-own}f}" if (own := _own_place(x, place)) <= 0 else f"{float(text):.0f}"
        for x, text in zip(numbers, scientific, strict=True)
    )
    return min(usual, scientific, key=lambda texts: max(map(len, texts)))


def _scientific(x: float, place: int) -> str:
    if x == 0.0:
        return "0"
    return f"{x:.{floor(log10(abs(x))) - _own_place(x, place)}e}"


def _own_place(x: float, place: int) -> int:
    """Return the last decimal place of a number, which keeps at least one digit."""
    return min(place, floor(log10(abs(x)))) if x else place


def listed(words: Sequence[str]) -> str:
    """Return words as an enumeration, with "and" before the last."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


VERDICT_STYLES: dict[Verdict, str] = {
    "determined": "green",
    "weak": "yellow",
    "undetermined": "red",
}


def value_texts(value: float, lower: float, upper: float) -> tuple[str, str]:
    """Return a number and its interval as texts for a table."""
    shown, low, high = format_with_interval(value, lower, upper)
    return shown, f"[{low}, {high}]"
