"""Columns of a file as numbers, with the place of a bad cell in errors, and time in seconds.

Time stamps are numbers in some unit, dates with times, or times of day. Polars reads stamps as
whole nanoseconds. The first one is subtracted before they become floating-point numbers, because
the resolution at 1.7e9 s since 1970 is 0.2 µs only. The same is done with numbers that count from
long ago, as integers or decimals.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording.names import cut, first_of, quoted, shortest_ends

if TYPE_CHECKING:
    import polars

_EMPTY = "the cell is empty: fill it in, or remove the row"
EXAMPLE = "2024-05-01T10:00:00.123"  # a time stamp, for messages
DECIMAL_COMMA = r"^[+-]?\d*,\d+(?:[eEdD][+-]?\d+)?$"
DECIMAL_POINT = r"^[+-]?\d*\.\d+(?:[eEdD][+-]?\d+)?$"
THOUSANDS = r"^[+-]?[1-9]\d{0,2},\d{3}$"
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}([.,'\s]\d{3})+([.,]\d*)?")
_FORTRAN = r"^([^a-zA-Z]*\d)[dD]([+-]?\d+)$"  # 1.5D-03
_SECONDS = r"^(\S+) sec$"  # as MATLAB writes a duration
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.I)
HOLE = r"(?i)^\s*(?:[+-]?nan(?:\(ind\))?|[+-]?1\.#(?:qnan|ind)\d*|n/?a|#n/?a|null|none|-+)?\s*$"


def is_number(cell: str) -> bool:
    """Whether a cell is a number, with a decimal point or a decimal comma, finite or not."""
    return _NUMBER.fullmatch(cell.strip()) is not None


def decimal_mark(frame: polars.DataFrame) -> str:
    """Return the decimal mark of text cells: a point if any cell has one, a comma, or none ("")."""
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
    """Return the line of a row from its index, which does not count lines that were left out."""
    line = first + index
    for other in left_out:
        line += other <= line
    return line


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a file, before conversion to numbers."""

    file: str  # as its path was given
    frame: polars.DataFrame  # columns of text for a text file, else of their types
    sha256: str = ""  # digest of the file's bytes
    header: str = ""  # place of the column names, such as "line 1"
    first_row: int = 1  # number of the first row of values, in lines or rows as `row_word` states
    row_word: str = "row"  # "line" for a text file
    warnings: tuple[str, ...] = ()  # on parts that were not read
    short: Mapping[str, str] = field(default_factory=dict)  # by path, its shortest unique end
    kinds: Mapping[str, str] = field(default_factory=dict)  # type and length by signal
    # decimal mark of a part of a stream, in which cells may be bad; None for a whole file
    mark: str | None = None
    left_out: Collection[int] = ()  # lines between the rows of a text that are no samples

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, as in the file."""
        return tuple(self.frame.columns)

    @property
    def listing(self) -> str:
        """Content of the file for a message: names, with type and length if the format has them."""
        if not self.kinds:
            return quoted(self.names)
        return first_of([f"{cut(name)!r} ({kind})" for name, kind in self.kinds.items()])

    def short_name(self, name: str) -> str:
        """Return the part of a column's name by which a channel is recognised."""
        return self._short_names.get(name, name)

    @cached_property
    def _short_names(self) -> Mapping[str, str]:
        return self.short or shortest_ends(self.names)

    def place(self, index: int, name: str) -> str:
        """Return the place in the file of row `index` (from 0) in column `name`, for a message."""
        return f"{self.row_word} {line_of(self.first_row, index, self.left_out)}, column {name!r}"

    def numbers(self, name: str, *, holes: bool = False) -> FloatArray:
        """Return a column as finite numbers, shape (n,); with `holes`, empty cells are NaN."""
        import polars as pl

        column = self.frame[name]
        if column.dtype.is_temporal():
            raise self._not_numeric(name, "dates or times of day")
        is_text = column.dtype == pl.String
        if self.row_word == "row" and not column.dtype.is_numeric():
            raise self._not_numeric(name, f"values of type {column.dtype}")
        # Parts of a stream have few cells, for which operations of Polars are too slow.
        if is_text and self.mark is not None:
            cells = [_with_point(cell, self.mark) for cell in column]
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
        bad = ~np.isfinite(values)
        if bad.any() and holes:
            is_hole = bad & self._is_hole(name)
            values[is_hole] = np.nan
            bad &= ~is_hole
        if bad.any():
            raise self._cell_error(name, np.flatnonzero(bad).tolist())
        return values

    def _is_hole(self, name: str) -> NDArray[np.bool_]:
        """Mask of the cells of a column that are empty or mark a missing value."""
        import polars as pl

        column = self.frame[name]
        if column.dtype.is_numeric():
            return (column.is_null() | column.cast(pl.Float64).is_nan().fill_null(False)).to_numpy()
        return column.fill_null("").str.contains(HOLE).to_numpy()

    @cached_property
    def has_decimal_commas(self) -> bool:
        """Whether the numbers of a text file have decimal commas."""
        return decimal_mark(self.frame) == ","

    def _cell_error(self, name: str, bad: list[int]) -> RecordingError:
        """Error for the first of some bad cells."""
        reason = _bad_cell(self.frame[name][bad[0]])
        if bad[1:] and reason.endswith("remove the row"):
            reason += f", and {len(bad) - 1} more without a number in this column"
        return RecordingError(self.file, self.place(bad[0], name), reason)

    def _not_numeric(self, name: str, found: str) -> RecordingError:
        remedy = "floating-point numbers"
        if "time" in name.lower():
            remedy = f"seconds since the start, or as stamps such as {EXAMPLE}"
        return RecordingError(
            self.file, f"column {name!r}", f"it holds {found}: write it as {remedy}"
        )


def _with_point(cell: str | None, mark: str) -> str | None:
    """Cell of a stream with a decimal point; if commas are the mark, points make it invalid."""
    if cell is None:
        return None
    text = cell.strip()
    if mark == ",":
        text = text.replace(".", "?").replace(",", ".")
    return re.sub(_FORTRAN, r"\1e\2", text) if "d" in text or "D" in text else text


def _bad_cell(cell: object) -> str:
    """Reason for refusing a cell that is not a finite number."""
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        return _EMPTY
    text = str(cell).strip()
    shown = cut(text, 24)
    if re.fullmatch(DECIMAL_COMMA, text):
        return (
            f"{shown!r} has a comma, which may be a decimal comma or one between "
            f"thousands: export with decimal points"
        )
    if _GROUPED.fullmatch(text):
        return f"{shown!r} has separators between thousands: export numbers without them"
    with suppress(ValueError):
        if not np.isfinite(float(text)):
            return f"{shown} is not a finite number: remove the row"
    return (
        f"{shown!r} is not a number such as -1.5e-3, nor a time stamp such as {EXAMPLE}: "
        f"correct it, or remove the row"
    )


LONG_AGO = 1e8  # s: a clock that starts later counts from long ago, so the log starts at zero

_DATES = {  # the range of years is that of 64-bit nanoseconds
    r"(?:1[789]|2[01])\d\d-\d\d-\d\d": "%Y-%m-%d",
    r"(?:1[789]|2[01])\d\d/\d\d/\d\d": "%Y/%m/%d",
    r"\d\d?\.\d\d?\.(?:1[789]|2[01])\d\d": "%d.%m.%Y",
    r"\d\d-[A-Z][a-z][a-z]-(?:1[789]|2[01])\d\d": "%d-%b-%Y",
}
_TIME = r"\d\d?:\d\d:\d\d(?:[.,]\d+)?"
_ZONE = r" ?(?:Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)"
_DAYS = r"\d+ days?,? "  # before a time of day, as Python writes a duration
_STAMP = re.compile(rf"\s*(?:({'|'.join(_DATES)})([T ])|{_DAYS})?{_TIME}({_ZONE})?\s*")
_OF_DAY = "%H:%M:%S%.f"
_LONGEST = 48  # characters of a stamp
_SINCE_1970 = (1e18, 2**63)  # ns, from the year 2001; times in other units are smaller
_OF_WINDOWS = "0.1 us"  # ticks since 1601
_LARGEST = 2**62  # largest difference of integers that does not overflow
_PLACES = 12  # decimal places that are read exactly, of 38 digits in all
_DAY = 86_400
_PER_SECOND = {"ns": 10**9, "us": 10**6, "ms": 10**3}


def is_stamp(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day.

    >>> is_stamp("2024-05-01 10:00:00.123456Z"), is_stamp("10:00:00,5"), is_stamp("2024-05-01")
    (True, True, False)
    """
    return len(cell) <= _LONGEST and _STAMP.fullmatch(cell) is not None


def _form_of(cell: str) -> str | None:
    """Format of a time stamp, in the notation of Polars; None for other text."""
    found = _STAMP.fullmatch(cell) if len(cell) <= _LONGEST else None
    if found is None or found[1] is None:
        return _OF_DAY if found else None  # the zone of a time of day is ignored
    date = next(form for pattern, form in _DATES.items() if re.fullmatch(pattern, found[1]))
    return f"{date}{found[2]}{_OF_DAY}{'%#z' if found[3] else ''}"


def _ticks(cells: polars.Series, form: str) -> polars.Series:
    """Nanoseconds since 1970 in UTC, or since midnight; null for cells of another format."""
    text = cells.str.strip_chars().str.replace(",", ".", literal=True)
    if form == _OF_DAY:  # `Clock` counts the days by the midnights
        time = text.str.extract(rf"^(?:{_DAYS})?({_TIME})")
        ticks = time.str.to_time(form, strict=False).to_physical()
    else:
        if form.endswith("z"):
            text = text.str.replace(r" ?(?:UTC|GMT|Z)$", "+00").str.replace(r" ([+-])", "$1")
        ticks = text.str.to_datetime(form, strict=False, time_unit="ns").to_physical()
    return ticks.set(~cells.str.contains(f"^{_STAMP.pattern}$"), None)


class Clock:
    """Conversion of a log's time to seconds, with one origin for all parts of a stream."""

    def __init__(self, *, since_1970: bool = False) -> None:
        self._since_1970 = since_1970
        self._origin: int | None = None  # tick from which time stamps are counted
        self._origins: dict[str, Any] = {}  # by column, the number from which others are counted
        self._form: str | None = None  # format of the time stamps; empty if there are none
        self._rows = 0  # number of rows so far, of a log without time stamps
        self._last: int | None = None  # tick of the last time of day
        self._days = 0  # midnights since the first one

    def stamped(self, table: Table, header: str) -> FloatArray | None:
        """Return a column of time stamps in s; None if it has none."""
        import polars as pl

        column = table.frame[header]
        dtype = column.dtype
        if dtype == pl.String:
            if self._form is None:
                self._form = _first_form(column) if table.mark is None else _usual_form(column)
            if not self._form:
                return None
            ticks, per_second = _ticks(column, self._form), 10**9
            is_of_day = self._form == _OF_DAY
        elif isinstance(dtype, pl.Datetime | pl.Duration | pl.Time):
            ticks, is_of_day = column.to_physical(), isinstance(dtype, pl.Time)
            per_second = 10**9 if isinstance(dtype, pl.Time) else _PER_SECOND[dtype.time_unit]
        else:
            return None
        if table.mark is None:
            self._check(table, header, ticks)
        seconds = np.full(len(ticks), np.nan)
        found = ticks.drop_nulls().to_numpy()
        found = self._over_midnight(found) if is_of_day else found
        seconds[ticks.is_not_null().to_numpy()] = self._seconds(found, per_second)
        return seconds

    def counted(self, rows: int) -> FloatArray:
        """Return the numbers of the next `rows` rows, counted from 0."""
        self._rows += rows
        return np.arange(self._rows - rows, self._rows, dtype=np.float64)

    def unit_of_count(self, table: Table, header: str) -> str | None:
        """Return the unit of large integers, such as times of ROS or Windows; None for others."""
        count = str(next(iter(table.frame[header].drop_nulls().head(1)), None)).strip()
        least, most = _SINCE_1970
        if not re.fullmatch(r"\d{18,19}", count) or int(count) >= most:
            return None
        return "ns" if int(count) >= least else _OF_WINDOWS

    def numbers(self, table: Table, header: str, scale: float) -> FloatArray:
        """Return a column of times in units of `scale` s, counted from the first if long ago."""
        import polars as pl

        found = table.numbers(header)
        if header not in self._origins:
            first = found[0] if len(found) else 0.0
            is_far = not self._since_1970 and abs(first * scale) > LONG_AGO
            exact = _exact(table, header) if is_far else None
            self._origins[header] = (first if exact is None else exact[0]) if is_far else 0.0
        origin = self._origins[header]
        exact = _exact(table, header) if origin else None
        if exact is None:
            return found - float(origin)
        return np.require((exact - origin).cast(pl.Float64).to_numpy(), np.float64, "W")

    def _seconds(self, ticks: NDArray[np.int64], per_second: int) -> FloatArray:
        """Ticks in s since the first one; differences are exact within a century."""
        if self._origin is None:
            self._origin = int(ticks[0]) if not self._since_1970 and len(ticks) else 0
        apart = ticks.astype(np.float64) - self._origin
        if np.abs(apart).max(initial=0.0) <= _LARGEST:
            apart = (ticks - self._origin).astype(np.float64)
        return apart / per_second

    def _over_midnight(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Times of day as ticks over midnights: each on the day closest to its predecessor."""
        if not len(ticks):
            return ticks
        day = _DAY * 10**9
        before = ticks[0] if self._last is None else self._last
        passed = -np.rint(np.diff(ticks, prepend=before) / day).astype(np.int64)
        days = self._days + np.cumsum(passed)
        self._last, self._days = int(ticks[-1]), int(days[-1])
        return ticks + day * days

    def _check(self, table: Table, header: str, ticks: polars.Series) -> None:
        """Raise for the first cell that is not a time stamp."""
        if not ticks.null_count():
            return
        column = table.frame[header]
        index = int(np.argmax(ticks.is_null().to_numpy()))
        text = str(column[index] or "").strip()
        reason = _EMPTY
        if text:
            first = str(column.drop_nulls()[0]).strip()
            what = f"a time stamp of the same form as the first one, {first!r}"
            what = "an existing date or time" if text == first else what
            reason = f"{cut(text, 40)!r} is not {what}: correct it, or remove the row"
        raise RecordingError(table.file, table.place(index, header), reason)


def _first_form(column: polars.Series) -> str | None:
    """Format of the first cell that is not empty; None if it is no time stamp."""
    filled = (cell.strip() for cell in column.head(100) if cell and cell.strip())
    return _form_of(next(filled, ""))


def _usual_form(column: polars.Series) -> str:
    """Most frequent format of time stamps; empty unless there are more stamps than numbers."""
    cells = [cell for cell in column if cell is not None]
    forms = Counter(form for form in map(_form_of, cells) if form is not None)
    is_stamped = forms.total() > sum(map(is_number, cells))
    return max(forms, key=lambda form: forms[form]) if is_stamped else ""


def _exact(table: Table, header: str) -> polars.Series | None:
    """Decimals or integers of a column at full precision; None if it has others."""
    import polars as pl

    column = table.frame[header]
    if column.dtype == pl.String:
        column = column.str.strip_chars()
        if table.has_decimal_commas:
            column = column.str.replace(",", ".", literal=True)
    elif not (isinstance(column.dtype, pl.Decimal) or column.dtype.is_integer()):
        return None
    found = column.cast(pl.Decimal(38, _PLACES), strict=False)
    return None if found.null_count() else found
