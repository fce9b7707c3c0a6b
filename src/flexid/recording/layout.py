"""Location of header, units and rows in a text file, between other lines of the logger."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from flexid.errors import RecordingError
from flexid.recording.names import cut, split_header
from flexid.recording.table import Table, is_number, is_stamp
from flexid.recording.units import is_usual

if TYPE_CHECKING:
    import polars

SEPARATORS = "\t;|,"  # in the order in which they are tried: a comma may be a decimal comma
BLANK = " "  # denotes columns that are separated by any number of blanks
COMMENTS = ("#", "%", "//")
LONGEST_PREAMBLE = 1_000  # lines before the numbers
_MORE_ROWS = 3  # rows of numbers that must follow the first: fewer may belong to a preamble
LONGEST_LINE = 1_000_000  # bytes, of a line and of the preamble
_NO_HEADER = "the file begins with numbers: write a header with the column names first"
_LABEL = re.compile(r"(?i)(type|units?|interp|blockpath|portindex|name): ?")


@dataclass(frozen=True)
class Layout:
    """Locations of the parts of a text file."""

    names: tuple[str, ...]  # of the columns, with the unit in brackets if there is a row of units
    separator: str  # between cells; `BLANK` for any number of blanks
    header_line: int  # line number from 1
    first_line: int  # line number of the first row of values
    start: int  # offset of the first row of values, in bytes
    skipped: Mapping[tuple[int, int], str] = field(default_factory=dict)  # reason by lines
    left_out: Mapping[int, str] = field(default_factory=dict)  # reason by line without a sample
    twins: tuple[tuple[str, str], ...] = ()  # duplicate columns: name, and its replacement

    def table(self, file: str, frame: polars.DataFrame, mark: str | None = None) -> Table:
        """Return the cells of rows as a table of this layout."""
        return Table(
            file,
            frame,
            header=f"line {self.header_line}",
            first_row=self.first_line,
            row_word="line",
            mark=mark,
            left_out=self.left_out,
        )

    def without_twins(self, file: str, frame: polars.DataFrame) -> polars.DataFrame:
        """Return columns without duplicates; raise if two of one name differ in their values."""
        for name, other in self.twins:
            if not frame[name].equals(frame[other]):
                raise RecordingError(
                    file,
                    f"line {self.header_line}",
                    f"the column {name!r} occurs twice, with different values: rename or remove "
                    f"one",
                )
        return frame.drop([other for _, other in self.twins])


@dataclass(frozen=True)
class _Line:
    file: str
    number: int
    begin: int  # offset of the line, in bytes
    end: int  # offset after its line feed
    text: str
    cells: tuple[str, ...] = ()  # empty until the separator is known

    @property
    def is_comment(self) -> bool:
        return self.text.lstrip(' "').startswith(COMMENTS)

    @property
    def bare(self) -> str:
        """The line without comment marks, as NumPy writes its header as a comment."""
        return self.text.lstrip(" #%/") if self.is_comment else self.text

    @property
    def label(self) -> str:
        """Label of the first cell, as "unit", if all cells have labels (Simulink); else empty."""
        found = [_LABEL.match(cell) for cell in self.cells if cell]
        return found[0][1].lower() if found and found[0] and all(found) else ""

    def parted(self, separator: str, width: int, *, is_ended: bool) -> _Line:
        """Return the line with its cells, `width` of them if it may contain the column names."""
        cells = split(self.bare, separator)
        aligned = re.split(r"\s{2,}", self.bare.strip())
        if separator == BLANK and len(aligned) == width != len(cells):  # names of several words
            cells = aligned
        if is_ended and len(cells) == width - 1:  # rows have a trailing separator
            cells.append("")
        if len(cells) == width + 1 and cells[-1].casefold() in ("comment", ""):  # LabVIEW's
            cells.pop()
        return replace(self, cells=tuple(cells))

    def refusal(self, reason: str) -> RecordingError:
        """Return the error that refuses the text because of this line."""
        return RecordingError(self.file, f"line {self.number}", reason)


def layout_of(file: str, text: bytes) -> Layout:
    """Return the location of header, units and first row in a UTF-8 text with line feeds.

    The header is the line of names above the first rows of numbers with as many cells. A row of
    units may lie between them. Lines before the header are a preamble.
    """
    lines, row = _to_first_row(file, text)
    plain = [line for line in lines if not line.is_comment]
    if not plain:
        raise RecordingError(
            file, "line 1", "there is nothing but comments: write the column names below them"
        )
    if row is None:  # without rows of numbers the first line is taken as the header
        bare = re.sub(r"\[[^\[\]]*\]|\([^()]*\)|\"[^\"]*\"", "", plain[0].text)
        separator = max(",;\t|", key=bare.count)  # outside units and quotes
        header = replace(plain[0], cells=tuple(split(plain[0].bare, separator)))
        return _layout([], header, None, separator, (header.number + 1, header.end))
    separator, width = row
    is_ended = not split(lines[-1].text, separator)[-1]
    lines = [line.parted(separator, width, is_ended=is_ended) for line in lines]
    header, units = _names_and_units(lines[:-1], lines[-1], width)
    below = [line for line in lines if line.number > header.number and line is not units]
    below = [line for line in below if not (line.is_comment or line.label)]
    if len(header.cells) == width:  # earlier rows may have another length
        below = [line for line in below if _is_row(line.cells)]
    return _layout(lines, header, units, separator, (below[0].number, below[0].begin))


def _names_and_units(above: list[_Line], first: _Line, width: int) -> tuple[_Line, _Line | None]:
    """Return the lines of the names and, if any, of the units above the first row."""
    fitting = [line for line in above if len(line.cells) == width and not _is_row(line.cells)]
    named = [line for line in fitting if not line.is_comment] or fitting
    if not named:  # no header fits the rows, which are refused later
        named = [line for line in above if not line.is_comment]
        if not named:
            raise first.refusal(_NO_HEADER)
        _check_quotes(named[0])
        several = [line for line in named if len(line.cells) > 1 and not _is_row(line.cells)]
        return (several or named[:1])[-1], None
    units = next((line for line in named if line.label.startswith("unit")), None)
    named = [line for line in named if not line.label] or named
    if len(named) > 1 and units is None and _is_units(named[-1].cells):
        units = named.pop()
    named = [line for line in named if not any(map(is_number, line.cells))] or named
    # Rows of types or groups have repeated cells.
    header = max(reversed(named), key=lambda line: len({*line.cells}))
    if units is None:
        others = (line for line in fitting if line is not header)
        units = next((line for line in others if _is_units(line.cells)), None)
    return header, units


def _check_quotes(header: _Line) -> None:
    if header.bare.count('"') % 2:
        raise header.refusal(
            "a quotation mark opens in the header and does not close on this line: write all "
            "column names in one line"
        )


def _to_first_row(file: str, text: bytes) -> tuple[list[_Line], tuple[str, int] | None]:
    """Lines up to the first row of numbers, with its separator and width; else all and None."""
    # Lines are read only as needed, since damaged ones may follow.
    ahead = _first_lines(file, text)
    lines: list[_Line] = []
    waiting: list[_Line] = []  # candidates for the first row and those after it
    while True:
        while len(waiting) <= _MORE_ROWS and (line := next(ahead, None)) is not None:
            lines.append(line)
            waiting += [] if line.is_comment else [line]
        if not waiting:
            return lines, None
        first, *waiting = waiting
        row = _row_of(first, waiting)
        if row is not None:
            return [line for line in lines if line.number <= first.number], row


def _row_of(first: _Line, following: list[_Line]) -> tuple[str, int] | None:
    """Separator and width of a row of numbers if the following lines are such rows too."""
    for separator in (*SEPARATORS, BLANK):
        cells = split(first.text, separator)
        if not _is_row(cells, all_of_them=separator == BLANK):
            continue
        others = [split(other.text, separator) for other in following]
        if all(len(other) == len(cells) and _is_row(other) for other in others):
            return separator, len(cells)
    return None


def _first_lines(file: str, text: bytes) -> Iterator[_Line]:
    """Lines at the beginning of a text, without blank ones."""
    position = 0
    for number in range(1, LONGEST_PREAMBLE + 3):
        if position >= min(len(text), LONGEST_LINE):
            return
        end = text.find(b"\n", position, position + LONGEST_LINE + 1) + 1
        if end == 0:
            end = len(text)
        if end - position > LONGEST_LINE:
            reason = f"the line has more than {LONGEST_LINE} bytes: write one line for each sample"
            raise RecordingError(file, f"line {number}", reason)
        line = text[position:end].decode("utf-8", errors="replace").rstrip("\r\n")
        if line.strip():
            yield _Line(file, number, position, end, line)
        position = end


def _is_row(cells: Sequence[str], *, all_of_them: bool = False) -> bool:
    """Whether there are two cells or more, of which most (or all) are numbers or time stamps."""
    count = sum(is_number(cell) or is_stamp(cell) for cell in cells)
    return len(cells) >= 2 and (count == len(cells) if all_of_them else 2 * count > len(cells))


def _is_units(cells: Sequence[str]) -> bool:
    """Whether at least half of the non-empty cells are units."""
    filled = [cell for cell in cells if cell]
    usual = [
        cell
        for cell in filled
        if is_usual(cell)
        or (re.fullmatch(r"\[.*\]|\(.*\)", cell) and not is_number(cell.strip("[()]")))
    ]
    return bool(usual) and 2 * len(usual) >= len(filled)


def split(line: str, separator: str) -> list[str]:
    """Return the stripped cells of a line; blanks within brackets do not separate cells."""
    if separator == BLANK:
        cells = re.findall(
            r"[^\s\[(\"]+(?:\s{0,9}\[[^\[\]]{0,99}\]|\s{0,9}\([^()]{0,99}\))?|\"[^\"]*\"|\S+", line
        )
        return [cell.strip('"') for cell in cells]
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=separator))]
    except (csv.Error, StopIteration):
        return []


def _layout(
    lines: list[_Line],
    header: _Line,
    units: _Line | None,
    separator: str,
    first_row: tuple[int, int],  # its line number, and its offset in bytes
) -> Layout:
    """Return the layout with these parts; raise if the names are unusable."""
    _check_quotes(header)
    if not header.cells:  # the csv module cannot read the line
        raise header.refusal("the header cannot be read: write shorter column names")
    names = [name or f"unnamed {number}" for number, name in enumerate(header.cells, start=1)]
    if all(map(is_number, names)):
        raise header.refusal(_NO_HEADER)
    if all(":" in name and is_number(name.partition(":")[2]) for name in names):
        reason = f"each cell has a name, as {cut(names[0])!r}: write the names in one line above"
        raise header.refusal(f"{reason}, and numbers alone below it")
    if units is not None:
        below = [_LABEL.sub("", cell) for cell in units.cells]
        label = below[0] if "unit" in below[0].lower() else ""  # label of the row, as Y_Unit_Label
        below = ["" if cell == label else cell for cell in below]
        names = [_with_unit(units, *pair) for pair in zip(names, below, strict=True)]
    if len({*names}) < len(names):
        names = _grouped(lines, header, names)
    twins = []
    for place, name in enumerate(names):
        if name in names[:place]:
            names[place] = f"{name} #{place + 1}"
            twins.append((name, names[place]))
    skipped = {}
    for begin, end, why in (
        (0, header.number, f"the column names are in line {header.number}"),
        (header.number, first_row[0], f"the numbers begin in line {first_row[0]}"),
    ):
        own = [line for line in lines if begin < line.number < end and line is not units]
        unread = [x.number for x in own if not (x.is_comment or x.label)]
        if unread:
            skipped[unread[0], unread[-1]] = why
    return Layout(tuple(names), separator, header.number, *first_row, skipped, twins=tuple(twins))


def _grouped(lines: list[_Line], header: _Line, names: list[str]) -> list[str]:
    """Repeated names, each prefixed by its group if a line above names the groups."""
    above = [line.cells for line in lines if line.number < header.number]
    fitting = [cells for cells in above if len(cells) == len(names) and not _is_row(cells)]
    if not fitting:
        return names
    groups, group = [], ""
    for cell in fitting[-1]:
        group = cell or group
        groups.append(group)
    found = [f"{group} {name}".strip() for group, name in zip(groups, names, strict=True)]
    return names if len({*found}) < len(found) else found


def _with_unit(line: _Line, name: str, unit: str) -> str:
    """A name with the unit from the row below it; raise if its own unit differs."""
    unit = re.sub(r"^[\[(](.*)[\])]$", r"\1", unit).strip()
    if unit in ("", "-"):
        return name
    bare, own = split_header(name)
    if own is None:
        return f"{name} [{unit}]"
    if own != unit:
        reason = f"the unit below the name is [{unit}]: make the two agree, or remove one"
        raise RecordingError(line.file, f"line {line.number}, column {name!r}", reason)
    return f"{bare} [{unit}]"
