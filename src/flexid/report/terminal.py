"""How answers are printed: as many digits as they deserve, in tables that never cut a number."""

import re
import shutil
import sys
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from math import floor, inf, isfinite, isnan, log10
from textwrap import wrap

from rich.cells import cell_len
from rich.console import Console
from rich.text import Text

from flexid.identification.vocabulary.evidence import Verdict

WIDEST = 100
"""Columns that an answer takes at most; longer lines are hard to read."""

USUAL = 80
"""Columns of an answer where there is no terminal to ask."""

_NARROWEST = 40  # columns below which a terminal breaks the lines itself

_BETWEEN = 2  # blanks between two columns
_NARROWEST_TEXT = 16  # columns of text that is broken into lines

_UNBROKEN = "\N{NO-BREAK SPACE}"
_TOGETHER = re.compile(
    r"(?<=\d) (?=(%|ms|s|N m|kg|rad|Hz|1/s|degrees?)\b|%)"  # a number and its unit
    r"|(?<=\bN) (?=m\b)|(?<=\bkg) (?=m\b)|(?<=\bN m) (?=s\b)"  # the parts of a unit
)

_SPELLED = {
    "±": "+-",
    "−": "-",
    "–": "-",
    "─": "-",
    "…": "...",
    "≤": "<=",
    "≥": ">=",
    "·": "*",
    "θ": "theta",
    "α": "alpha",
    "β": "beta",
    "γ": "gamma",
    "λ": "lambda",
    "μ": "mu",
    "ω": "omega",
    "°": "deg",
    "’": "'",
}


@dataclass(frozen=True)
class Cell:
    """What stands at one place of a table."""

    texts: tuple[str, ...]  # the one with most digits first; one of them is printed, whole
    style: str = ""  # a colour

    def at(self, level: int) -> str:
        """The text with so much left out."""
        return self.texts[min(level, len(self.texts) - 1)]

    def with_unit(self, unit: str) -> "Cell":
        """The same with a unit after it."""
        return Cell(tuple(f"{text} {unit}" for text in self.texts), self.style)


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    heading: str
    right: bool = False  # as numbers stand
    spare: int = 0  # where there is no room, columns with the largest number are left out first
    wraps: bool = False  # sentences, which may be broken into lines; for one column of a table


def numbers(*headings: str) -> tuple[Column, ...]:
    """Columns that stand on the right."""
    return tuple(Column(heading, right=True) for heading in headings)


@dataclass
class Table:
    """A table that is laid out when the width is known.

    It is printed with fewer digits where it would be too wide, then with fewer columns, then as a
    line for each row, in this order.
    """

    title: str
    columns: Sequence[Column]  # the first one names the rows
    _rows: list[tuple[Cell, ...] | None] = field(default_factory=list)

    @property
    def rows(self) -> Sequence[tuple[Cell, ...] | None]:
        """The rows; None is a line between two."""
        return self._rows

    def add(self, *cells: Cell | str) -> None:
        """Add a row; cells that are missing at its end are empty."""
        row = [cell if isinstance(cell, Cell) else Cell((cell,)) for cell in cells]
        row += [Cell(("",))] * (len(self.columns) - len(row))
        self._rows.append(tuple(row))

    def rule(self) -> None:
        """Add a line between the rows before and those that follow."""
        self._rows.append(None)

    def lines(self, width: int) -> Iterator[Text]:
        """The table within some columns, and an empty line below it."""
        yield from (Text(line, "bold") for line in wrapped(self.title, width))
        levels = max((len(c.texts) for row in self._rows if row for c in row), default=1)
        for places in self._ever_fewer_columns():
            for level in range(levels):
                for headings_wrap in (False, True):
                    widths = self._widths(places, level, width, headings_wrap)
                    if widths is not None:
                        yield from self._aligned(places, level, widths)
                        yield Text()
                        return
        yield from self._entries(width)
        yield Text()

    def _ever_fewer_columns(self) -> Iterator[list[int]]:
        places = list(range(len(self.columns)))
        yield places
        for gone in sorted({c.spare for c in self.columns if c.spare}, reverse=True):
            places = [place for place in places if self.columns[place].spare != gone]
            yield places

    def _widths(
        self, places: Sequence[int], level: int, width: int, headings_wrap: bool
    ) -> list[int] | None:
        """The width of each column; None if they do not fit."""
        found = []
        for place in places:
            column = self.columns[place]
            heading = _longest_word(column.heading) if headings_wrap else cell_len(column.heading)
            longest = _longest_word if column.wraps else cell_len
            cells = (longest(row[place].at(level)) for row in self._rows if row)
            found.append(max(heading, *cells, 0))
        left = width - sum(found) - _BETWEEN * (len(found) - 1)
        for i, place in enumerate(places):
            if self.columns[place].wraps:
                cells = (cell_len(row[place].at(level)) for row in self._rows if row)
                whole = max(cells, default=0)
                found[i] += min(left, max(0, whole - found[i]))
                if found[i] < min(whole, _NARROWEST_TEXT):
                    return None
        return found if left >= 0 else None

    def _aligned(self, places: Sequence[int], level: int, widths: Sequence[int]) -> Iterator[Text]:
        columns = [self.columns[place] for place in places]
        heads = [
            wrap(c.heading, w) if cell_len(c.heading) > w else [c.heading]
            for c, w in zip(columns, widths, strict=True)
        ]
        depth = max(map(len, heads))
        lowered = [[*[""] * (depth - len(head)), *head] for head in heads]
        yield from _put_beside(lowered, [""] * len(columns), columns, widths)
        rule = Text("─" * (sum(widths) + _BETWEEN * (len(widths) - 1)))
        yield rule
        for row in self._rows:
            if row is None:
                yield rule
                continue
            cells = [row[place] for place in places]
            texts = [
                wrapped(cell.at(level), w) or [""] if column.wraps else [cell.at(level)]
                for cell, column, w in zip(cells, columns, widths, strict=True)
            ]
            yield from _put_beside(texts, [cell.style for cell in cells], columns, widths)

    def _entries(self, width: int) -> Iterator[Text]:
        """Each row as a sentence."""
        for row in self._rows:
            if row is None:
                continue
            parts = [
                f"{column.heading} {cell.at(0)}".strip()
                for column, cell in zip(self.columns[1:], row[1:], strict=True)
                if cell.at(0)
            ]
            name = row[0].at(0)
            said = f"{name}: {', '.join(parts)}" if parts else name
            yield from map(Text, wrapped(said, width, "  "))


Part = Table | Text | str
"""A table or a sentence, which is a `Text` where it has a style."""


def number(value: float, digits: int, unit: str = "") -> Cell:
    """A number with so many significant digits, or fewer, but three, where there is no room."""
    texts = [f"{value:.{d}g}" for d in range(digits, min(digits, 3) - 1, -1)]
    if abs(value) < 1e6:  # no power of ten for what has at most six digits before the point
        texts = [f"{float(text):.0f}" if "e+0" in text else text for text in texts]
    cell = Cell(tuple(dict.fromkeys(texts)))
    return cell.with_unit(unit) if unit else cell


def wrapped(text: str, width: int, indent: str = "") -> list[str]:
    """Lines of a sentence; nothing is broken that belongs together. Blanks at its start stay."""
    before = text[: len(text) - len(text.lstrip())]
    lines = wrap(
        _TOGETHER.sub(_UNBROKEN, text.strip()),
        width,
        initial_indent=before,
        subsequent_indent=before + indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return [line.replace(_UNBROKEN, " ") for line in lines] or [""]


def print_parts(parts: Iterable[Part]) -> None:
    """Print tables and texts on standard output, one after the other."""
    columns = shutil.get_terminal_size((USUAL, 24)).columns
    width = min(max(columns, _NARROWEST), WIDEST)
    console, parts = _Console(), [*parts]
    lines = list(laid_out(parts, width))
    if not encodable("".join(line.plain for line in lines)):  # what is spelled takes more room
        narrower = (list(laid_out(parts, width - spare)) for spare in range(width // 4))
        fitting = (page for page in narrower if max(len(spelled(t.plain)) for t in page) <= width)
        lines = next(fitting, lines)
    for line in lines:
        console.print(line, soft_wrap=True)
    sys.stdout.flush()  # what cannot be written fails here, and not when Python ends


class _Console(Console):
    """A console that says when its reader has left, instead of ending the process."""

    def on_broken_pipe(self) -> None:
        raise


def laid_out(parts: Iterable[Part], width: int) -> Iterator[Text]:
    """Tables and texts as lines of at most so many columns, without blanks at their ends.

    Of several empty lines one is left, and none at the end.
    """
    empty = False
    for part in parts:
        for line in part.lines(width) if isinstance(part, Table) else _lines_of(part, width):
            line.rstrip()
            if line.plain and empty:
                yield Text()
            empty = not line.plain
            if line.plain:
                yield line


def _lines_of(sentence: Text | str, width: int) -> Iterator[Text]:
    text = Text(sentence) if isinstance(sentence, str) else sentence
    indent = "  " if text.plain.startswith("  ") else ""
    for line in wrapped(text.plain, width, indent):
        yield Text(line, text.style)


def encodable(text: str) -> bool:
    """Whether standard output can show a text as it is."""
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        return False
    return True


def spelled(text: str) -> str:
    """Text in ASCII, for terminals that have no Greek."""

    def ascii_of(character: str) -> str:
        bare = unicodedata.normalize("NFKD", character).encode("ascii", "ignore").decode()
        return _SPELLED.get(character) or bare or "?"

    return "".join(c if c.isascii() else ascii_of(c) for c in text)


def _longest_word(text: str) -> int:
    return max(map(cell_len, text.split()), default=0)


def _put_beside(
    texts: Sequence[Sequence[str]],
    styles: Sequence[str],
    columns: Sequence[Column],
    widths: Sequence[int],
) -> Iterator[Text]:
    """Lines of a row whose cells have lines of their own."""
    for shown in zip_longest(*texts, fillvalue=""):
        cells = [Text(text, style) for text, style in zip(shown, styles, strict=True)]
        for cell, column, width in zip(cells, columns, widths, strict=True):
            cell.align("right" if column.right else "left", width)
        yield Text(" " * _BETWEEN).join(cells)


_MOST = 15  # significant digits, beyond which a float's own rounding begins


def format_with_interval(
    value: float, lower: float, upper: float, digits: int = 2
) -> tuple[str, str, str]:
    """Numbers as text, with as many digits as the width of the interval justifies."""
    numbers = (value, lower, upper)
    width = upper - lower
    if isnan(width) or not isfinite(value) or width < 0.0 or width == inf:
        first, second, third = ("–" if isnan(x) else f"{x:.1g}" for x in numbers)
    elif width == 0.0:
        first, second, third = (f"{x:.6g}" for x in numbers)
    else:
        largest = max(map(abs, numbers))
        place = max(floor(log10(width)) - digits + 1, floor(log10(largest)) - _MOST + 1)
        first, second, third = _rounded(numbers, place)
    return first, second, third


def _rounded(numbers: Sequence[float], place: int) -> tuple[str, ...]:
    """Numbers rounded to a power of ten: as usual, or all scientific where that is shorter."""
    scientific = tuple(_scientific(x, place) for x in numbers)
    usual = tuple(
        f"{x:.{max(0, -_own_place(x, place))}f}" if place <= 0 or x == 0.0 else f"{float(text):.0f}"
        for x, text in zip(numbers, scientific, strict=True)
    )
    return min(usual, scientific, key=lambda texts: max(map(len, texts)))


def _scientific(x: float, place: int) -> str:
    if x == 0.0:
        return "0"
    return f"{x:.{floor(log10(abs(x))) - _own_place(x, place)}e}"


def _own_place(x: float, place: int) -> int:
    """The last place of a number: it keeps one digit at least."""
    return min(place, floor(log10(abs(x)))) if x else place


def listed(words: Sequence[str]) -> str:
    """Words in a row, with "and" before the last."""
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


VERDICT_STYLES: dict[Verdict, str] = {
    "determined": "green",
    "weak": "yellow",
    "undetermined": "red",
}


def verdict_cell(verdict: Verdict) -> Cell:
    """A verdict for a table, in its colour."""
    return Cell((verdict,), VERDICT_STYLES[verdict])


def value_cells(value: float, lower: float, upper: float) -> tuple[Cell, Cell]:
    """A number and its interval for a table: two digits of the width, or one."""
    values, intervals = [], []
    for digits in (2, 1):
        shown, low, high = format_with_interval(value, lower, upper, digits)
        values.append(shown)
        intervals.append(f"[{low}, {high}]")
    return Cell(tuple(values)), Cell(tuple(intervals))
