"""When samples were taken: numbers in some unit, dates with times, or times of day, as seconds.

Time stamps are read by Polars into whole nanoseconds, and only what is left after the first one is
taken off them becomes a floating-point number: of 1.7e9 s since 1970 that would keep 0.2 µs. So
are numbers that count from long ago, as integers or as decimals.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import time
from decimal import Decimal
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError

if TYPE_CHECKING:
    from collections.abc import Sequence

    import polars
    from numpy.typing import NDArray

    from flexid.arrays import FloatArray
    from flexid.recording.table import Table

LONG_AGO = 1e8
"""Seconds beyond which a clock counts from long ago, and the log from its own beginning."""

_DATES = {  # the years are those that 64 bits of nanoseconds hold
    r"(?:1[789]|2[01])\d\d-\d\d-\d\d": "%Y-%m-%d",
    r"(?:1[789]|2[01])\d\d/\d\d/\d\d": "%Y/%m/%d",
    r"\d\d?\.\d\d?\.(?:1[789]|2[01])\d\d": "%d.%m.%Y",
}
_TIME = r"\d\d?:\d\d:\d\d(?:[.,]\d+)?"
_ZONE = r" ?(?:Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)"
_STAMP = re.compile(rf"\s*(?:({'|'.join(_DATES)})([T ]))?{_TIME}({_ZONE})?\s*")
_LONGEST = 48  # characters of a stamp
_EXACT = 2**53  # integers up to which are floating-point numbers, too
_LARGEST = 2**62  # differences up to which those of integers do not wrap
_PLACES = 12  # behind the point of a decimal that is read exactly, of 38 digits in all
_DAY = 86_400
_PER_SECOND = {"ns": 10**9, "us": 10**6, "ms": 10**3}


def is_stamp(cell: str) -> bool:
    """Whether a cell is a date with a time, or a time of day.

    >>> is_stamp("2024-05-01 10:00:00.123456Z"), is_stamp("10:00:00,5"), is_stamp("2024-05-01")
    (True, True, False)
    """
    return len(cell) <= _LONGEST and _STAMP.fullmatch(cell) is not None


def is_time_of_day(cell: object) -> bool:
    """Whether a cell is a time of day without its date.

    >>> is_time_of_day("10:00:00,5"), is_time_of_day("2024-05-01 10:00:00"), is_time_of_day(1.0)
    (True, False, False)
    """
    if isinstance(cell, str):
        found = _STAMP.fullmatch(cell[:_LONGEST])
        return found is not None and not found[1]
    return isinstance(cell, time)


def digits_of(cell: object) -> int:
    """Digits behind the point of a stamp; 0 of anything else.

    >>> digits_of("01.05.2024 10:00:00,25 UTC"), digits_of("10:00:00"), digits_of("1.25")
    (2, 0, 0)
    """
    if not (isinstance(cell, str) and is_stamp(cell)):
        return 0
    found = re.search(r":\d\d[.,](\d+)", cell)
    return len(found[1]) if found else 0


@dataclass(frozen=True)
class _Form:
    """How all stamps of a column are written.

    Parameters
    ----------
    date : str
        A pattern of `_DATES`; empty for a time of day.
    between : str
        What stands between date and time.
    zoned : bool
        Whether a time zone follows.
    """

    date: str
    between: str
    zoned: bool

    @classmethod
    def of(cls, cell: str) -> _Form | None:
        """That of one stamp; None of what is none."""
        found = _STAMP.fullmatch(cell) if len(cell) <= _LONGEST else None
        if found is None:
            return None
        day = found[1] or ""
        date = next((pattern for pattern in _DATES if re.fullmatch(pattern, day)), "")
        return cls(date, found[2] or "", bool(found[3]) and bool(date))

    @cached_property
    def _pattern(self) -> str:
        # Of a time of day the zone says nothing.
        zone = _ZONE if self.zoned else "" if self.date else f"(?:{_ZONE})?"
        return rf"^{self.date}{self.between}{_TIME}{zone}$"

    def ticks(self, cells: polars.Series) -> polars.Series:
        """Nanoseconds since 1970 in UTC, or since midnight; null where a cell is otherwise."""
        import polars as pl

        cells = cells.str.strip_chars()
        name = cells.name
        fitting = cells.to_frame().select(
            pl.when(pl.col(name).str.contains(self._pattern)).then(pl.col(name))
        )[name]
        text = fitting.str.replace(",", ".", literal=True)
        if not self.date:
            text = text.str.extract(rf"^({_TIME})")
            return text.str.to_time("%H:%M:%S%.f", strict=False).to_physical()
        form = f"{_DATES[self.date]}{self.between}%H:%M:%S%.f"
        if self.zoned:
            text = text.str.replace(r" ?(?:UTC|GMT|Z)$", "+00").str.replace(r" ([+-])", "$1")
            form += "%#z"
        return text.str.to_datetime(form, strict=False, time_unit="ns").to_physical()


class Clock:
    """What the time of a log is counted from, the same in each of its parts.

    Time stamps, and numbers that count from long ago, are counted from the first one.

    Parameters
    ----------
    since_1970 : bool, optional
        Whether they are left as they are instead, time stamps from 1970 in UTC: of a stream, which
        may be gone on with another day.
    """

    def __init__(self, *, since_1970: bool = False) -> None:
        self._since_1970 = since_1970
        self._origin: int | None = None  # tick from which time stamps are counted
        self._origins: dict[
            str, int | float | Decimal
        ] = {}  # by column, the number from which others are
        self._form: _Form | None = None
        self._last: int | None = None  # tick of the last time of day
        self._days = 0  # midnights since the first one

    def stamped(self, table: Table, header: str) -> FloatArray | None:
        """Seconds of a column of time stamps; None where it holds anything else.

        Raises
        ------
        RecordingError
            If one of them is none, or is written otherwise than the first.
        """
        import polars as pl

        column = table.frame[header]
        dtype = column.dtype
        if dtype == pl.String:
            self._form = self._form or _first_form(column)
            if self._form is None:
                return None
            ticks = self._form.ticks(column)
            self._check(table, header, ticks)
            found = ticks.to_numpy()
            return self._seconds(found if self._form.date else self._over_midnight(found), 10**9)
        if not isinstance(dtype, pl.Datetime | pl.Duration | pl.Time):
            return None
        ticks = column.to_physical()
        self._check(table, header, ticks)
        found = ticks.to_numpy()
        if isinstance(dtype, pl.Time):
            return self._seconds(self._over_midnight(found), 10**9)
        return self._seconds(found, _PER_SECOND[dtype.time_unit])

    def numbers(self, table: Table, header: str, scale: float) -> FloatArray:
        """Numbers of a column, from the first one on where that is long ago.

        Parameters
        ----------
        table : Table
        header : str
            The column.
        scale : float
            Seconds in one of its numbers.

        Raises
        ------
        RecordingError
            If a cell is empty, is not a number, or is not finite.
        """
        import polars as pl

        decimals = None if self._since_1970 else _long_decimals(table, header)
        if decimals is not None:
            origin = self._origins.get(header, decimals[0])
            if isinstance(origin, Decimal) and abs(float(origin) * scale) > LONG_AGO:
                self._origins[header] = origin
                apart = (decimals - origin).cast(pl.Float64).to_numpy()
                return np.require(apart, np.float64, "W")
        found = _large_integers(table.frame[header])
        if found is None:
            found = table.numbers(header)
        if header not in self._origins:
            first = found[0].item() if len(found) else 0
            far = not self._since_1970 and abs(first * scale) > LONG_AGO
            self._origins[header] = first if far else 0
        return _since(found, self._origins[header])

    def of_cells(self, cells: Sequence[bytes]) -> FloatArray:
        """Seconds of some time stamps as they came; NaN where one is none."""
        import polars as pl

        column = pl.Series("time", [cell.decode("utf-8", "replace") for cell in cells], pl.String)
        seconds = np.full(len(cells), np.nan)
        self._form = self._form or _first_form(column)
        if self._form is None:
            return seconds
        ticks = self._form.ticks(column)
        is_one = ticks.is_not_null().to_numpy()
        found = ticks.drop_nulls().to_numpy()
        found = found if self._form.date else self._over_midnight(found)
        seconds[is_one] = self._seconds(found, 10**9)
        return seconds

    def _seconds(self, ticks: NDArray[np.int64], per_second: int) -> FloatArray:
        if self._origin is None:
            self._origin = int(ticks[0]) if not self._since_1970 and len(ticks) else 0
        return _since(ticks, self._origin) / per_second

    def _over_midnight(self, ticks: NDArray[np.int64]) -> NDArray[np.int64]:
        """Times of day, each of the day in which it is nearest to the one before."""
        if not len(ticks):
            return ticks
        day = _DAY * 10**9
        before = ticks[0] if self._last is None else self._last
        passed = -np.rint(np.diff(ticks, prepend=before) / day).astype(np.int64)
        days = self._days + np.cumsum(passed)
        self._last, self._days = int(ticks[-1]), int(days[-1])
        return ticks + day * days

    def _check(self, table: Table, header: str, ticks: polars.Series) -> None:
        """Raise at the first cell that is no time stamp."""
        if not ticks.null_count():
            return
        column = table.frame[header]
        index = int(np.argmax(ticks.is_null().to_numpy()))
        cell = column[index]
        text = "" if cell is None else str(cell).strip()
        reason = "the cell is empty: fill it in, or remove the row"
        if text:
            shown = text if len(text) <= 40 else text[:37] + "..."
            first = str(column.drop_nulls()[0]).strip()
            reason = (
                f"{shown!r} is no date or time that there is: correct it, or remove the row"
                if text == first
                else f"{shown!r} is no time stamp, or written otherwise than the first one, "
                f"{first!r}: correct it, or remove the row"
            )
        raise RecordingError(table.file, table.place(index, header), reason)


def _since(found: NDArray[np.int64] | FloatArray, origin: int | float | Decimal) -> FloatArray:
    """Differences from an origin, exact where they are; absurd ones are refused later."""
    with np.errstate(over="ignore"):
        apart = np.asarray(found, dtype=np.float64) - float(origin)
        if found.dtype.kind == "f" or np.abs(apart).max(initial=0.0) > _LARGEST:
            return apart
    return (found - np.int64(origin)).astype(np.float64)


def _first_form(column: polars.Series) -> _Form | None:
    """How the first cell that is not empty is written."""
    for cell in column.head(100):
        if cell is not None and cell.strip():
            return _Form.of(cell.strip())
    return None


def _long_decimals(table: Table, header: str) -> polars.Series | None:
    """Numbers with a fraction of which floating-point numbers keep too few digits: 1714557600.1."""
    import polars as pl

    column = table.frame[header]
    if column.dtype == pl.String:
        column = column.str.strip_chars()
        first = (column[0] or "") if len(column) else ""
        if not re.fullmatch(r"\d{9,}(?:[.,]\d*)?", first):
            return None
        if table.has_decimal_commas:
            column = column.str.replace(",", ".", literal=True)
    elif not isinstance(column.dtype, pl.Decimal) or not len(column):
        return None
    found = column.cast(pl.Decimal(38, _PLACES), strict=False)
    return None if found.null_count() else found


def _large_integers(column: polars.Series) -> NDArray[np.int64] | None:
    """Integers of which floating-point numbers keep too few digits, as nanoseconds since 1970."""
    import polars as pl

    head = column.head(1)
    if column.dtype == pl.String:
        first = (head[0] or "").strip() if len(head) else ""
        if not re.fullmatch(r"[+-]?\d{16,19}", first):
            return None
        column = column.str.strip_chars()
    elif not column.dtype.is_integer():
        return None
    found = column.cast(pl.Int64, strict=False)
    if found.null_count() or not len(found) or abs(int(found[0])) < _EXACT:
        return None
    return found.to_numpy()
