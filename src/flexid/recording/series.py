"""Reading of signal files: columns of a log, at once or in parts, and an overview."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.errors import RecordingError
from flexid.readers.formats import PARQUET, STAMPS, Series, format_of
from flexid.readers.guard import Reading
from flexid.recording.columns import recipes_of
from flexid.recording.names import (
    cut,
    first_of,
    folded,
    quoted,
    shortest_ends,
    split_header,
    usual_channel,
)
from flexid.recording.one_clock import Signal, on_one_clock
from flexid.recording.recipes import MapSource
from flexid.recording.recording import INPUTS, MOST_ROWS, check_cells
from flexid.recording.table import Table
from flexid.recording.text import read_table

if TYPE_CHECKING:
    import polars

TIME = "time [s]"
_TEMPORAL = ("Datetime", "Time")  # types of Polars for time stamps
_EXPORT = "export the log again"


def names_of(reading: Reading) -> Table:
    """Return a table without rows, with all names, from which the columns to read are selected."""
    import polars as pl

    file, series = reading.file, reading.series
    if reading.is_table and (not series or not series[0].length):
        raise RecordingError(file, "", f"the file holds no samples: {_EXPORT}")
    if not series:
        found = first_of([f"{cut(name)!r} ({why})" for name, why in reading.others.items()])
        only = f", only {found}" if found else ""
        raise RecordingError(file, "", f"the file holds no signals{only}: {_EXPORT}")
    check_cells(file, 1, len(series))
    if reading.is_table:
        kinds = {one.path: one.kind.partition("(")[0] for one in series}
        known = {path: kind if kind in _TEMPORAL else "Float64" for path, kind in kinds.items()}
        frame = pl.DataFrame(schema={path: getattr(pl, kind) for path, kind in known.items()})
        return Table(file, frame, reading.sha256)
    headers = [*map(_header_of, series)]
    short = shortest_ends(_header_of(one) for one in series if not one.is_twin)
    if _is_clocked(reading):  # the clocks are the time, so a signal named time is not
        for header, end in short.items():
            if folded(split_header(end)[0]) == "time":
                short[header] = f"logged {end}"
        headers = [TIME, *headers]
    kinds = {_header_of(one): f"{one.kind}, {one.length} values" for one in series}
    frame = pl.DataFrame(schema=dict.fromkeys(headers, pl.Float64))
    return Table(file, frame, reading.sha256, short=short, kinds=kinds | reading.others)


Part = tuple["polars.DataFrame", tuple[str, ...]]  # with warnings


class Signals:
    """The signals of a file that a log needs."""

    def __init__(self, reading: Reading, columns: MapSource | None) -> None:
        self.reading, self.file, self.names = reading, reading.file, names_of(reading)
        recipes, self.warnings = recipes_of(self.names, columns)
        self.is_clocked = _is_clocked(reading)
        self.headers = {  # by channel, the headers that it is computed from
            channel: [one for one in recipe.weights if one != TIME or not self.is_clocked]
            for channel, recipe in recipes.items()
        }
        used = {header for of in self.headers.values() for header in of}
        every = {_header_of(one): one for one in reading.series}
        self.chosen = {header: one for header, one in every.items() if header in used}
        self.paths = {one.path: header for header, one in self.chosen.items()}

    def tables(self, size: int | None) -> Iterator[Table]:
        """Yield the signals in tables of about `size` rows; without a size, in one table."""
        empty = [one.path for one in self.chosen.values() if not one.length]
        if empty or not self.chosen:
            reason = f"the signals {quoted(empty)} have no samples: {_EXPORT}"
            raise RecordingError(self.file, "", reason)
        longest = max(one.length for one in self.chosen.values())
        held = longest if size is None or self.is_clocked else min(size, longest)
        check_cells(self.file, held, len(self.chosen))
        if size is None and longest > MOST_ROWS:
            is_parquet = self.reading.format is PARQUET
            remedy = "identify it with --stream, or " if is_parquet else ""
            raise RecordingError(
                self.file,
                "",
                f"it has {longest} rows, more than the {MOST_ROWS} that are read at once: "
                f"{remedy}cut the log into shorter files",
            )
        row = 1
        for frame, found in (self._clocked if self.is_clocked else self._together)(size):
            warnings = (*self.warnings, *found)
            yield replace(self.names, frame=frame, first_row=row, warnings=warnings)
            row += frame.height

    def _together(self, size: int | None) -> Iterator[Part]:
        """Yield columns of a table, or arrays of one length and one time."""
        times = self.headers["time"] or [*self.chosen]  # any signal if the time is counted
        time = self.chosen[times[0]]
        for one in self.chosen.values():
            if one.length != time.length:
                raise RecordingError(
                    self.file,
                    f"{one.path!r}",
                    f"it has {one.length} values where {time.path!r} has {time.length}: bring the "
                    f"two to one clock, and save them at one length",
                )
        for _, frame in self.reading.frames(self.paths, size or MOST_ROWS):
            yield frame.select([*self.paths]).rename(self.paths), ()

    def _clocked(self, size: int | None) -> Iterator[Part]:
        """Yield signals with separate clocks, resampled to one."""
        first = [self.chosen[header] for header in self.headers.get("motor_position", ())]
        clocks = list(dict.fromkeys(one.clock for one in (*first, *self.chosen.values())))
        notes = [note for one in clocks if (note := self.reading.notes.get(one))]
        held: dict[str, list[polars.DataFrame]] = {clock: [] for clock in clocks}
        for clock, frame in self.reading.frames(self.paths, size or MOST_ROWS):
            held[clock].append(frame)
        whole, warnings = self._of_one_clock(_stamped(held))
        for part in whole.iter_slices(size or MOST_ROWS):
            yield part, (*(f"{self.file}: {note}" for note in notes), *warnings)

    def _of_one_clock(self, stamped: dict[str, polars.DataFrame]) -> Part:
        """Chosen signals at common times, and warnings."""
        import polars as pl

        if len(stamped) == 1:
            (frame,) = stamped.values()
            return frame.select(pl.col(STAMPS).alias(TIME), *self.paths).rename(self.paths), ()
        inputs = {header for name in INPUTS for header in self.headers.get(name, ())}
        signals = []
        for header, one in self.chosen.items():
            column = stamped[one.clock].select(pl.col(one.path).alias(header))
            values = Table(self.file, column).numbers(header)
            signals.append(Signal(header, one.clock, values, header in inputs))
        clocks = {clock: frame[STAMPS].to_numpy() for clock, frame in stamped.items()}
        times, found, warnings = on_one_clock(self.file, clocks, signals)
        return pl.DataFrame({TIME: times, **found}), warnings


def _is_clocked(reading: Reading) -> bool:
    """Whether signals have time stamps from separate clocks."""
    return any(one.clock for one in reading.series)


def _stamped(held: dict[str, list[polars.DataFrame]]) -> dict[str, polars.DataFrame]:
    """Values by clock, with times in s; whole nanoseconds are sorted and count from the first."""
    import polars as pl

    found = {clock: pl.concat(parts) for clock, parts in held.items()}
    whole = {
        clock: frame.sort(STAMPS, maintain_order=True)
        for clock, frame in found.items()
        if frame[STAMPS].dtype.is_integer()
    }
    origin = min((frame[STAMPS][0] for frame in whole.values()), default=0)
    seconds = (pl.col(STAMPS) - origin) * 1e-9
    return found | {clock: frame.with_columns(seconds) for clock, frame in whole.items()}


def _header_of(series: Series) -> str:
    """Path of a signal with its unit in brackets."""
    return f"{series.path} [{series.unit}]" if series.unit else series.path


_ROWS = 5  # rows of an overview
_LONGEST_CELL = 24  # characters


@dataclass(frozen=True)
class ColumnOverview:
    """A column of a file, for an overview."""

    header: str  # as in the file
    unit: str  # as stated in the name; empty without one
    kind: str  # type and length of a signal; empty for a column of a table
    cells: tuple[str, ...]  # its first values


@dataclass(frozen=True)
class FileOverview:
    """Columns of a file, and the channels that they are recognised as."""

    rows: int  # samples of the longest signal
    columns: tuple[ColumnOverview, ...]  # in the file's order
    channels: dict[str, str]  # by channel, the header of its column
    unclear: str  # reason if channels cannot be recognised, else empty


def overview(path: Path) -> FileOverview:
    """Return an overview of a file of any format."""
    if format_of(path) is None:
        table = read_table(path)
        return _overview(table, table.frame.height, _cells(table.frame))
    with Reading(path) as reading:
        names, series = names_of(reading), reading.series
        cells = {}
        if reading.is_table:
            _, frame = next(reading.frames([one.path for one in series], _ROWS))
            cells = _cells(frame)
        return _overview(names, max(one.length for one in series), cells)


def _cells(frame: polars.DataFrame) -> dict[str, tuple[str, ...]]:
    """First values of each column as text."""

    def text(cell: object) -> str:
        if isinstance(cell, float):
            return f"{cell:.9g}"
        return "" if cell is None else str(cell).strip()

    return {
        column.name: tuple(cut(text(cell), _LONGEST_CELL) for cell in column)
        for column in frame.head(_ROWS)
    }


def _overview(table: Table, rows: int, cells: dict[str, tuple[str, ...]]) -> FileOverview:
    short = {header: table.short_name(header) for header in table.names}
    usual = {header: one for header, name in short.items() if (one := usual_channel(name))}
    columns = []
    for header, name in short.items():
        unit = split_header(name)[1] or (usual[header].unit if header in usual else None) or ""
        kind = "" if header == TIME else table.kinds.get(header, "")
        columns.append(ColumnOverview(header, unit, kind, cells.get(header, ())))
    channels, unclear = {}, ""
    try:
        recipes, _ = recipes_of(table, None)
        channels = {name: recipe.header for name, recipe in recipes.items()}
    except RecordingError as error:
        unclear = error.reason
        for header, one in usual.items():
            channels.setdefault(one.channel, header)
    return FileOverview(rows, tuple(columns), channels, unclear)
