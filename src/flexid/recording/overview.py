"""What a file holds, before anybody says which column is which channel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.errors import RecordingError
from flexid.readers.formats import format_of
from flexid.readers.guard import Reading
from flexid.recording.columns import recipes_of
from flexid.recording.names import cut, split_header, usual_channel
from flexid.recording.series import TIME, names_of, with_own_times
from flexid.recording.table import Table
from flexid.recording.text import read_table

if TYPE_CHECKING:
    import polars

_ROWS = 5  # that are shown
_LONGEST_CELL = 24  # characters


@dataclass(frozen=True)
class ColumnOverview:
    """A column of a file."""

    header: str  # as it stands in the file
    unit: str  # that its name states, if any
    kind: str  # type and length of a signal in a file that is no table
    cells: tuple[str, ...]  # its first values


@dataclass(frozen=True)
class FileOverview:
    """Columns of a file, and what their names say."""

    file: str
    sha256: str
    rows: int  # samples of the longest signal
    columns: tuple[ColumnOverview, ...]  # in the file's order
    channels: dict[str, str]  # by channel, the header that it would be read from
    unclear: str  # why the names do not say what is what, if they do not


def overview(path: Path) -> FileOverview:
    """What a file of any format holds."""
    if format_of(path) is None:
        table = read_table(path)
        return _overview(table, table.frame.height, _cells(table.frame))
    with Reading(path) as reading:
        known = with_own_times(reading, None)
        names, series = names_of(known), known.series
        cells = {}
        if reading.is_table:
            _, frame = next(reading.frames([one.path for one in series], _ROWS))
            cells = _cells(frame)
        return _overview(names, max(one.length for one in series), cells)


def _cells(frame: polars.DataFrame) -> dict[str, tuple[str, ...]]:
    """The first values of each column as text."""
    return {
        column.name: tuple(cut(_text(cell), _LONGEST_CELL) for cell in column)
        for column in frame.head(_ROWS)
    }


def _text(cell: object) -> str:
    if cell is None:
        return ""
    return f"{cell:.9g}" if isinstance(cell, float) else str(cell).strip()


def _overview(table: Table, rows: int, cells: dict[str, tuple[str, ...]]) -> FileOverview:
    columns = tuple(
        ColumnOverview(
            header,
            _unit(table, header),
            "" if header == TIME else table.kinds.get(header, ""),
            cells.get(header, ()),
        )
        for header in table.names
    )
    channels, unclear = {}, ""
    try:
        recipes, _ = recipes_of(table, None)
        channels = {name: recipe.header for name, recipe in recipes.items()}
    except RecordingError as error:
        unclear = error.reason
        for header in table.names:
            usual = usual_channel(table.short_name(header))
            if usual is not None:
                channels.setdefault(usual[0], header)
    return FileOverview(table.file, table.sha256, rows, columns, channels, unclear)


def _unit(table: Table, header: str) -> str:
    """The unit that a column's name states."""
    short = table.short_name(header)
    usual = usual_channel(short)
    return split_header(short)[1] or (usual[1] if usual else None) or ""
