"""Columns of a file as numbers, every bad cell with its place."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording.names import cut, first_of, quoted, shortest_ends

if TYPE_CHECKING:
    import polars

EXAMPLE = "2024-05-01T10:00:00.123"  # a time stamp, for messages
DECIMAL_COMMA = r"^[+-]?\d*,\d+(?:[eEdD][+-]?\d+)?$"
DECIMAL_POINT = r"^[+-]?\d*\.\d+(?:[eEdD][+-]?\d+)?$"
THOUSANDS = r"^[+-]?[1-9]\d{0,2},\d{3}$"
_FORTRAN = r"^([^a-zA-Z]*\d)[dD]([+-]?\d+)$"  # 1.5D-03
_SECONDS = r"^(\S+) sec$"  # as MATLAB writes a duration
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.I)
HOLE = r"(?i)^\s*(?:[+-]?nan(?:\(ind\))?|[+-]?1\.#(?:qnan|ind)\d*|n/?a|#n/?a|null|none|-+)?\s*$"


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or a decimal comma, finite or not."""
    return _NUMBER.fullmatch(cell.strip()) is not None


def decimal_mark(frame: polars.DataFrame) -> str:
    """The decimal mark of cells that are text, a point before any comma; empty if none shows it."""
    import polars as pl

    mark = ""
    for column in frame:
        if column.dtype == pl.String:
            text = column.str.strip_chars()
            if text.str.contains(DECIMAL_POINT).any():
                return "."
            is_comma = text.str.contains(DECIMAL_COMMA) & ~text.str.contains(THOUSANDS)
            mark = "," if is_comma.any() else mark
    return mark


def line_of(first: int, index: int, left_out: Collection[int]) -> int:
    """Where a row stands, whose number from 0 does not count the lines that were left out."""
    line = first + index
    for other in left_out:
        line += other <= line
    return line


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a file, not yet numbers."""

    file: str  # as its path was given
    frame: polars.DataFrame  # text columns of a text file, else typed ones
    sha256: str = ""  # digest of the file's bytes
    header: str = ""  # where the names of the columns stand, such as "line 1"
    first_row: int = 1  # number of the first row of values, as `row_word` counts
    row_word: str = "row"  # "line" for a text file
    warnings: tuple[str, ...] = ()  # what was not read of it
    short: Mapping[str, str] = field(default_factory=dict)  # ends of paths that name a channel
    kinds: Mapping[str, str] = field(default_factory=dict)  # type and length of what it holds
    # of a part of a stream, whose cells may be no numbers: its decimal mark
    mark: str | None = None
    left_out: Collection[int] = ()  # lines of a text between its rows that hold no sample

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, as they stand in the file."""
        return tuple(self.frame.columns)

    @property
    def listing(self) -> str:
        """What the file holds: the names, with type and length where the format has them."""
        if not self.kinds:
            return quoted(self.names)
        return first_of([f"{cut(name)!r} ({kind})" for name, kind in self.kinds.items()])

    def short_name(self, name: str) -> str:
        """The part of a column's name by which a channel is recognised."""
        return self._short_names.get(name, name)

    @cached_property
    def _short_names(self) -> Mapping[str, str]:
        return self.short or shortest_ends(self.names)

    def place(self, index: int, name: str) -> str:
        """Where the value of column `name` in row `index` (from 0) stands in the file."""
        return f"{self.row_word} {line_of(self.first_row, index, self.left_out)}, column {name!r}"

    def numbers(self, name: str, *, holes: bool = False) -> FloatArray:
        """A column as finite numbers, shape (n,); with holes, empty cells are NaN."""
        import polars as pl

        column = self.frame[name]
        if column.dtype.is_temporal():
            raise self._not_numeric(name, "dates or times of day")
        is_text = column.dtype == pl.String
        if self.row_word == "row" and not column.dtype.is_numeric():
            raise self._not_numeric(name, f"values of type {column.dtype}")
        # Of a stream a few cells come at a time, for which an operation of Polars takes too long.
        if is_text and self.mark is not None:
            cells = [_plain(cell, self.mark) for cell in column]
            numbers = pl.Series(cells, dtype=pl.String).cast(pl.Float64, strict=False)
            return np.require(numbers.to_numpy(), np.float64, "W")
        numbers = column.cast(pl.Float64, strict=False)
        if is_text and numbers.null_count() > column.null_count():
            column = column.str.strip_chars().str.replace(_FORTRAN, "${1}e$2")
            column = column.str.replace(_SECONDS, "$1")
            if self.has_decimal_commas:
                column = column.str.replace(",", ".", literal=True)
            numbers = column.cast(pl.Float64, strict=False)
        values = np.require(numbers.to_numpy(), np.float64, "W")
        with np.errstate(all="ignore"):  # of numbers too large to be added
            total = values.sum()
        # It is finite only if all numbers are, and faster than asking each.
        if not (np.isfinite(total) or np.isfinite(values).all()):
            bad = ~np.isfinite(values)
            if holes:
                bad &= ~self._is_hole(name)
                values[~np.isfinite(values) & ~bad] = np.nan
            if bad.any():
                raise self._no_number(name, np.flatnonzero(bad).tolist())
        return values

    def _is_hole(self, name: str) -> NDArray[np.bool_]:
        """Which cells of a column say that there is no value."""
        import polars as pl

        column = self.frame[name]
        if column.dtype.is_numeric():
            return (column.is_null() | column.cast(pl.Float64).is_nan().fill_null(False)).to_numpy()
        return column.fill_null("").str.contains(HOLE).to_numpy()

    @cached_property
    def has_decimal_commas(self) -> bool:
        """Whether the numbers of a text have decimal commas."""
        return decimal_mark(self.frame) == ","

    def _no_number(self, name: str, bad: list[int]) -> RecordingError:
        """What is wrong with the first of some cells."""
        reason = _bad_cell(self.frame[name][bad[0]])
        if bad[1:] and reason.endswith("remove the row"):
            reason += f", and {len(bad) - 1} more of the column that are no numbers"
        return RecordingError(self.file, self.place(bad[0], name), reason)

    def _not_numeric(self, name: str, found: str) -> RecordingError:
        remedy = "floating-point numbers"
        if "time" in name.lower():
            remedy = f"seconds since the start, or as stamps such as {EXAMPLE}"
        return RecordingError(
            self.file, f"column {name!r}", f"it holds {found}: write it as {remedy}"
        )


def _plain(cell: str | None, mark: str) -> str | None:
    """A cell of a stream as Polars writes numbers; with decimal commas a point is none."""
    if cell is None:
        return None
    text = cell.strip()
    if mark == ",":
        text = text.replace(".", "?").replace(",", ".")
    return re.sub(_FORTRAN, r"\1e\2", text) if "d" in text or "D" in text else text


def _bad_cell(cell: object) -> str:
    """Say what is wrong with a cell that is no finite number."""
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        return "the cell is empty: fill it in, or remove the row"
    text = str(cell).strip()
    shown = cut(text, 24)
    if re.fullmatch(DECIMAL_COMMA, text):
        return (
            f"{shown!r} has a comma, and it cannot be known whether that of a decimal or between "
            f"thousands: export with decimal points"
        )
    with suppress(ValueError):
        if not np.isfinite(float(text)):
            return f"{shown} is not a finite number: remove the row"
    return (
        f"{shown!r} is not a number such as -1.5e-3, nor a time stamp such as {EXAMPLE}: "
        f"correct it, or remove the row"
    )
