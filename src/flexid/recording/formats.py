"""Which reader takes a file, by the end of its name."""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING

from flexid.recording.blocks import ParquetBlocks
from flexid.recording.columns import channel_columns
from flexid.recording.series import table_of_series, tables_of_series
from flexid.recording.table import PARQUET_SUFFIXES, read_table

if TYPE_CHECKING:
    from collections.abc import Generator
    from pathlib import Path

    from flexid.recording.column_map import MapSource
    from flexid.recording.series import SeriesFile
    from flexid.recording.table import Table

SERIES = {
    ".mat": "matlab",
    ".h5": "hdf5",
    ".hdf5": "hdf5",
    ".mcap": "ros",
    ".bag": "ros",
    ".db3": "ros",
    ".mf4": "mdf",
    ".mdf": "mdf",
}
"""Modules of this package whose `open_series` reads the files whose names end so."""


def table_of_file(path: Path, columns: MapSource | None) -> Table:
    """Columns of a log, whatever its format.

    Parameters
    ----------
    path : Path
        A file, or the folder of a ROS 2 bag.
    columns : Path, mapping or None
        A column map, which says what is read of a file that holds more.

    Raises
    ------
    RecordingError
        If the file cannot be read, or lacks a signal that is needed.
    """
    module = _module_of(path)
    if module is None:
        return read_table(path)
    return table_of_series(_opened(module, path), columns)


def tables_of_file(path: Path, columns: MapSource | None, size: int) -> Generator[Table]:
    """The same, of about so many rows at a time where the format can be read so.

    Parameters
    ----------
    path : Path
        A file, or the folder of a ROS 2 bag.
    columns : Path, mapping or None
        A column map.
    size : int
        Rows of a table.

    Raises
    ------
    RecordingError
        As `table_of_file`; for a file that is damaged on the way, after the tables before.
    """
    module = _module_of(path)
    if module is not None:
        yield from tables_of_series(_opened(module, path), columns, size)
    elif path.suffix.lower() in PARQUET_SUFFIXES:
        blocks = ParquetBlocks(path)
        yield from blocks.tables(channel_columns(blocks.head(1), columns), size)
    else:
        yield read_table(path)


def _module_of(path: Path) -> str | None:
    return "ros" if os.path.isdir(path) else SERIES.get(path.suffix.lower())


def _opened(module: str, path: Path) -> SeriesFile:
    return import_module(f"flexid.recording.{module}").open_series(path)
