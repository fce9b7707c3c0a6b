"""Signals by name, each of its own length and clock, as the columns of a log."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.channel import INPUTS
from flexid.recording.columns import sources
from flexid.recording.limits import MOST_ROWS, check_cells
from flexid.recording.names import cut, first_of, folded, split_header
from flexid.recording.one_clock import Signal, on_one_clock
from flexid.recording.table import Table

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Generator, Iterator, Mapping

    import polars
    from numpy.typing import NDArray

    from flexid.arrays import FloatArray
    from flexid.recording.column_map import MapSource

TIME = "time [s]"
LONGEST_PATH = 300  # characters
_MOST_PARTS = 8  # of a path that are looked at for its shortest end


@dataclass(frozen=True, eq=False)
class Series:
    """A signal of a file, not yet read.

    Parameters
    ----------
    path : str
        Where it stands, as a column map names it.
    kind : str
        Type of its values, for a list of what the file holds.
    length : int
        How many there are.
    values : callable
        Reads them, shape (length,).
    unit : str
        As the file states it; empty where it does not.
    clock : str
        Whose time stamps are those of the values: a key of `SeriesFile.clocks`, or in a file of
        arrays the path of the times beside them; empty where it has none.
    """

    path: str
    kind: str
    length: int
    values: Callable[[], NDArray[np.generic]]
    unit: str = ""
    clock: str = ""

    @property
    def header(self) -> str:
        """Its path, with the unit in brackets."""
        return f"{self.path} [{self.unit}]" if self.unit else self.path


@dataclass(frozen=True, eq=False)
class SeriesFile:
    """What a file holds.

    Parameters
    ----------
    file : str
        Its path, as it was given.
    sha256 : str
        Digest of its bytes.
    series : tuple of Series
    others : mapping of str to str
        What else it holds, and why that is no signal.
    clocks : mapping of str to callable
        Read time stamps in s. Without any, the file holds arrays, and one of them is the time.
    clock_warnings : mapping of str to str
        What there is to say of a clock where it is used.
    prepare : callable
        Called with the signals that are wanted before their values are, for formats of which a
        signal cannot be read alone.
    parts : callable or None
        Called with the signals that are wanted and a number of values. In each turn of what it
        returns, values and clocks are those of the file's next part, of about so many, with some
        from around it; the turn's two times, in s, are those after which the part begins and at
        which it ends. None for formats that are read whole.
    close : callable
        Called when nothing more is wanted, or something was wrong.
    """

    file: str
    sha256: str
    series: tuple[Series, ...]
    others: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[str, Callable[[], FloatArray]] = field(default_factory=dict)
    clock_warnings: Mapping[str, str] = field(default_factory=dict)
    prepare: Callable[[Collection[Series]], None] = lambda _: None
    parts: Callable[[Collection[Series], int], Iterator[tuple[float, float]]] | None = None
    close: Callable[[], None] = lambda: None


def table_of_series(held: SeriesFile, columns: MapSource | None) -> Table:
    """The signals that a log needs, read and brought to one clock.

    Parameters
    ----------
    held : SeriesFile
    columns : Path, mapping or None
        A column map: a TOML file, or what it would hold.

    Raises
    ------
    RecordingError
        If a signal that is needed is missing, or signals have no clock in common.
    """
    try:
        return _table(held, columns)
    finally:
        held.close()


def tables_of_series(held: SeriesFile, columns: MapSource | None, size: int) -> Generator[Table]:
    """The same in tables of about so many rows, where the format can be read in parts.

    Raises
    ------
    RecordingError
        As `table_of_series`; for a part that is damaged, after the tables before it.
    """
    import polars as pl

    try:
        if held.parts is None:
            yield _table(held, columns)
            return
        wanted = _Wanted(held, columns, in_parts=True)
        row = 1
        for begin, end in held.parts(wanted.chosen.values(), size):
            if not held.clocks:
                wanted.check_together()
            table = wanted.table(row)
            if held.clocks:
                time = pl.col(TIME)
                table = replace(table, frame=table.frame.filter((time > begin) & (time <= end)))
            if table.frame.height:
                yield table
                row += table.frame.height
        if row == 1:
            raise RecordingError(
                held.file, "", "its channels have no times in common: log them by one clock"
            )
    finally:
        held.close()


def _table(held: SeriesFile, columns: MapSource | None) -> Table:
    wanted = _Wanted(held, columns)
    longest = max((series.length for series in wanted.chosen.values()), default=0)
    check_cells(held.file, longest, len(wanted.chosen))
    if longest > MOST_ROWS:
        raise RecordingError(
            held.file,
            "",
            f"a signal has {longest} values, more than the {MOST_ROWS} that are read at once: "
            f"write a shorter part of the log",
        )
    held.prepare(wanted.chosen.values())
    if not held.clocks:
        wanted.check_together()
    return wanted.table(1)


class _Wanted:
    """The signals that a log needs, of those that a file holds."""

    def __init__(
        self, held: SeriesFile, columns: MapSource | None, *, in_parts: bool = False
    ) -> None:
        self._held = held
        self._names = names_of(held)
        found, self._warnings = sources(self._names, columns)
        self._headers = {channel: [h for h in of if h != TIME] for channel, of in found.items()}
        by_header = {series.header: series for series in held.series}
        self.chosen = {h: by_header[h] for of in self._headers.values() for h in of}
        """By header."""
        self._ranges: dict[str, tuple[float, float]] | None = {} if in_parts else None

    def check_together(self) -> None:
        """Raise unless arrays are of one length, and of the clock that was chosen."""
        _check_together(self._held, self._headers, self.chosen)

    def table(self, first_row: int) -> Table:
        """What they hold now."""
        held, warnings = self._held, self._warnings
        if held.clocks:
            frame, found = _clocked(held, self._headers, self.chosen, self._ranges)
            warnings += found
        else:
            frame = _frame(held.file, {h: series.values() for h, series in self.chosen.items()})
        short = {header: end for header, end in self._names.short.items() if header in self.chosen}
        kinds = self._names.kinds
        return Table(held.file, "", first_row, "row", frame, held.sha256, warnings, short, kinds)


def names_of(held: SeriesFile) -> Table:
    """A table without rows, from which is decided what is read."""
    import polars as pl

    if not held.series:
        found = first_of([f"{cut(name)!r} ({why})" for name, why in held.others.items()])
        raise RecordingError(
            held.file,
            "",
            f"the file holds no signals{f', only {found}' if found else ''}: export the log again",
        )
    check_cells(held.file, 1, len(held.series))
    short = _shortest_ends(held.series)
    headers = list(short)
    if held.clocks:  # these are the time; a signal that is called so is not
        for header, end in short.items():
            if folded(split_header(end)[0]) == "time":
                short[header] = f"logged {end}"
        headers = [TIME, *headers]
    kinds = {series.header: f"{series.kind}, {series.length} values" for series in held.series}
    frame = pl.DataFrame(schema=dict.fromkeys(headers, pl.Float64))
    return Table(held.file, "", 1, "row", frame, held.sha256, (), short, {**kinds, **held.others})


def _shortest_ends(series: tuple[Series, ...]) -> dict[str, str]:
    """By header, the shortest end of its path that no other path has, with the unit."""
    ends: dict[str, str] = {}
    for count in range(1, _MOST_PARTS + 1):
        tails = {one.header: _end(one.path, count) for one in series}
        times = Counter(tails.values())
        for one in series:
            tail = tails[one.header]
            if times[tail] == 1 and one.header not in ends:
                ends[one.header] = tail + one.header[len(one.path) :]
    return {one.header: ends.get(one.header, one.header) for one in series}


def _end(path: str, count: int) -> str:
    """The last so many parts of a path."""
    starts = [0, *(match.end() for match in re.finditer(r"[/.]", path))]
    return path[starts[-count] :] if count <= len(starts) else path


def _check_together(
    held: SeriesFile, headers: Mapping[str, list[str]], chosen: Mapping[str, Series]
) -> None:
    by_path = {series.path: series for series in held.series}
    time = chosen[headers["time"][0]]
    for series in chosen.values():
        if series.length != time.length:
            raise RecordingError(
                held.file,
                f"{series.path!r}",
                f"it has {series.length} values where {time.path!r} has {time.length}: bring the "
                f"two to one clock, and save them at one length",
            )
        own = by_path.get(series.clock)
        if own is None or own is time:
            continue
        if own.length != time.length or not np.array_equal(own.values(), time.values()):
            raise RecordingError(
                held.file,
                f"{series.path!r}",
                f"its times stand in {own.path!r} and differ from those in {time.path!r}: bring "
                f"the two to one clock, and save them with one time",
            )


def _clocked(
    held: SeriesFile,
    headers: Mapping[str, list[str]],
    chosen: Mapping[str, Series],
    ranges: dict[str, tuple[float, float]] | None,
) -> tuple[polars.DataFrame, tuple[str, ...]]:
    """The chosen signals at common times; with ranges, of a part, whose values widen them."""
    import polars as pl

    first = [chosen[header] for header in headers.get("motor_position", ())]
    names = dict.fromkeys(series.clock for series in (*first, *chosen.values()))
    warnings = tuple(held.clock_warnings[name] for name in names if name in held.clock_warnings)
    clocks = {name: held.clocks[name]() for name in names}
    if len(clocks) == 1:
        (times,) = clocks.values()
        columns = {header: series.values() for header, series in chosen.items()}
        return _frame(held.file, {TIME: times, **columns}), warnings
    inputs = {header for name in INPUTS for header in headers.get(name, ())}
    signals = []
    for header, series in chosen.items():
        values, span = _numbers(held, series), None
        if ranges is not None:
            low, high = ranges.get(header, (np.inf, -np.inf))
            ranges[header] = low, high = min(low, values.min()), max(high, values.max())
            span = high - low
        signals.append(Signal(header, series.clock, values, header in inputs, span))
    times, columns, found = on_one_clock(held.file, clocks, signals)
    if ranges is not None and not len(times):
        return pl.DataFrame({TIME: times, **columns}), warnings
    return _frame(held.file, {TIME: times, **columns}), warnings + found


def _numbers(held: SeriesFile, series: Series) -> FloatArray:
    """Values of a signal; raise where one is not finite."""
    frame = _frame(held.file, {series.header: series.values()})
    return Table(held.file, "", 1, "row", frame, held.sha256).numbers(series.header)


def _frame(file: str, columns: Mapping[str, NDArray[np.generic]]) -> polars.DataFrame:
    import polars as pl

    lengths = {len(values) for values in columns.values()}
    if lengths == {0}:
        raise RecordingError(file, "", "the signals hold no samples: export the log again")
    return pl.DataFrame({name: np.ascontiguousarray(values) for name, values in columns.items()})
