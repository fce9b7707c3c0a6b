"""Lines of a stream as rows of numbers, by the rules of a log's text.

What a whole log shows, whether its numbers have decimal commas, a stream shows with the first
number that has one or a point; a comma that may as well stand between thousands decides nothing,
and is no number until then.
"""

from __future__ import annotations

import re
from copy import copy

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.clock import Clock, is_stamp
from flexid.recording.layout import BLANK, COMMENTS, Layout, is_number, split
from flexid.recording.table import DECIMAL_COMMA, DECIMAL_POINT, THOUSANDS
from flexid.recording.text import MINUS

_COMMENTS = tuple(mark.encode() for mark in COMMENTS)
_COMMA = re.compile(DECIMAL_COMMA.encode())
_POINT = re.compile(DECIMAL_POINT.encode())
_THOUSANDS = re.compile(THOUSANDS.encode())
_FIRST_STAMPS = 5  # by which one of them the others are read
_EXPONENT = bytes.maketrans(b"dD", b"ee")


def _may_be_row(line: bytes) -> bool:
    """Whether a line is neither blank nor a comment."""
    stripped = line.strip()
    return bool(stripped) and not stripped.startswith(_COMMENTS)


def mark_of(lines: list[bytes], layout: Layout) -> bytes:
    """The decimal mark of some lines; empty where no number shows it.

    A point decides, before any comma.
    """
    reader, found = RowReader(layout), b""
    for line in lines:
        for cell in reader.cells(line) if _may_be_row(line) else []:
            if _POINT.match(cell):
                return b"."
            if _COMMA.match(cell) and not _THOUSANDS.match(cell):
                found = b","
    return found


def stamped_in(lines: list[bytes], layout: Layout) -> tuple[int, ...]:
    """Columns of some lines with more time stamps than numbers.

    The first line alone says nothing: a stream may be joined in the midst of it, or begin before
    its clock is set.
    """
    reader = RowReader(layout)
    counts = [0] * len(layout.names)
    for line in lines:
        cells = reader.cells(line)
        if len(cells) == len(counts):
            for column, cell in enumerate(cells):
                text = cell.decode("utf-8", "replace")
                counts[column] += 1 if is_stamp(text) else -is_number(text)
    return tuple(column for column, count in enumerate(counts) if count > 0)


class RowReader:
    """Numbers of one line after the other."""

    def __init__(self, layout: Layout, mark: bytes = b"", before: RowReader | None = None) -> None:
        self._separator = None if layout.separator == BLANK else layout.separator.encode()
        clocks = before.clocks() if before is not None else {}
        self._clocks = {
            column: clocks.get(layout.names[column]) or Clock(since_1970=True)
            for column in layout.stamped
        }
        self._begun: set[int] = set()  # columns of which a stamp has come
        self._mark = mark
        self.layout = layout

    def again(self) -> RowReader:
        """A reader of another text that is written in the same way."""
        return RowReader(self.layout, self._mark, self)

    def clocks(self) -> dict[str, Clock]:
        """The clocks as they stand, by their columns' names: they go on apart from this reader."""
        return {self.layout.names[column]: copy(clock) for column, clock in self._clocks.items()}

    def numbers(self, lines: list[bytes]) -> FloatArray:
        """Numbers of lines that are not empty nor comments, shape (n, n_columns).

        A line that is no row has none, a cell that is no number is NaN.
        """
        width = len(self.layout.names)
        rows = []
        stamps: dict[int, list[bytes]] = {column: [] for column in self._clocks}
        for line in lines:
            if not _may_be_row(line):
                continue
            cells = self.cells(line)
            for column, found in stamps.items():
                found.append(cells[column] if column < len(cells) else b"")
                cells[column : column + 1] = [b"0"]
            rows.append(self._row(cells) if len(cells) == width else [np.nan] * width)
        numbers = np.array(rows, dtype=np.float64).reshape(len(rows), width)
        for column, found in stamps.items():
            numbers[:, column] = self._times(column, found)
        return numbers

    def _times(self, column: int, cells: list[bytes]) -> FloatArray:
        """Seconds of the stamps of one column, counted by the first that is whole."""
        times = np.full(len(cells), np.nan)
        first = 0 if column in self._begun else _first_stamp(cells)
        if first is not None:
            if column not in self._begun:
                self._begin(column, cells[first])
            times[first:] = self._clocks[column].of_cells(cells[first:])
        return times

    def _begin(self, column: int, cell: bytes) -> None:
        """Take the first stamp of a column, which may be written otherwise than in another text."""
        self._begun.add(column)
        if np.isnan(copy(self._clocks[column]).of_cells([cell])).all():
            self._clocks[column] = Clock(since_1970=True)

    def most_are_rows(self, lines: list[bytes], used: list[int]) -> bool:
        """Whether half of some lines or more have numbers, or nothing, in the columns that count.

        Numbers that are not finite are such: something else is wrong there.
        """
        fitting = []
        for line in lines:
            if _may_be_row(line):
                cells = self.cells(line)
                is_whole = len(cells) == len(self.layout.names)
                fitting.append(is_whole and all(self._is_value(cells[c], c) for c in used))
        return 2 * sum(fitting) >= len(fitting)

    def _is_value(self, cell: bytes, column: int) -> bool:
        text = cell.decode("utf-8", "replace").strip()
        if not text:
            return True
        if column in self._clocks:
            return is_stamp(text)
        return text.lower().lstrip("+-") == "nan" or not np.isnan(self._number(cell))

    def cells(self, line: bytes) -> list[bytes]:
        """The cells of a line, without quotation marks."""
        line = line.rstrip(b"\r\n").replace(b"_", b"?")  # Python's 1_000 is no number in a log
        if not line.isascii():
            line = line.replace(MINUS, b"-")
        if b'"' in line:
            text = line.decode("utf-8", "replace")
            return [cell.strip('"').encode() for cell in split(text, self.layout.separator)]
        return line.split(self._separator)

    def _row(self, cells: list[bytes]) -> list[float]:
        if self._mark != b",":
            try:
                row = [float(cell) for cell in cells]
            except ValueError:
                return [self._number(cell) for cell in cells]
            if not self._mark and any(b"." in cell for cell in cells):
                self._mark = b"."
            return row
        return [self._number(cell) for cell in cells]

    def _number(self, cell: bytes) -> float:
        cell = cell.strip()
        if not self._mark and b"," in cell and _COMMA.match(cell) and not _THOUSANDS.match(cell):
            self._mark = b","
        if self._mark == b",":
            cell = b"?" if b"." in cell else cell.replace(b",", b".")
        try:
            number = float(cell.translate(_EXPONENT))
        except ValueError:
            return float("nan")
        if b"." in cell:
            self._mark = self._mark or b"."
        return number


def _first_stamp(cells: list[bytes]) -> int | None:
    """The first time stamp that is written as most of those behind it; None if there is none.

    Of a date with a time that came in part, the time of day may be left.
    """
    stamps = [k for k, cell in enumerate(cells) if is_stamp(cell.decode("utf-8", "replace"))]
    for k in stamps[:_FIRST_STAMPS]:
        behind = [cells[other] for other in stamps if other >= k]
        if 2 * np.isfinite(Clock(since_1970=True).of_cells(behind)).sum() > len(behind):
            return k
    return stamps[0] if stamps else None
