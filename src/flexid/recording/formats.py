"""Which reader takes a file, by the end of its name."""

from __future__ import annotations

import os
from importlib import import_module
from typing import TYPE_CHECKING

from flexid.recording.series import table_of_series
from flexid.recording.table import read_table

if TYPE_CHECKING:
    from pathlib import Path

    from flexid.recording.column_map import MapSource
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
    module = "ros" if os.path.isdir(path) else SERIES.get(path.suffix.lower())
    if module is None:
        return read_table(path)
    held = import_module(f"flexid.recording.{module}").open_series(path)
    return table_of_series(held, columns)
