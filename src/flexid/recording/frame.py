"""Data frames and arrays in memory as tables of columns."""

import errno
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from flexid.errors import RecordingError
from flexid.readers.arrays import known_times
from flexid.recording.names import split_header
from flexid.recording.recording import MOST_ROWS
from flexid.recording.table import Table

FRAME = "data frame"
ARRAYS = "arrays"


def is_frame(data: object) -> bool:
    """Whether an object is a data frame of pandas, Polars, PyArrow or another library."""
    import narwhals as nw

    return nw.dependencies.is_into_dataframe(data)


def table_of_frame(frame: Any) -> Table:
    """Return the columns of a data frame of any library that narwhals supports, as a table."""
    import narwhals as nw

    if nw.dependencies.is_pandas_dataframe(frame):
        frame = _with_index(frame)
    try:
        table = nw.from_native(frame, eager_only=True)
    except nw.exceptions.DuplicateError as error:
        reason = f"{' '.join(str(error).split())}: rename or remove duplicate columns"
        raise RecordingError(FRAME, "", reason) from None
    names = [name for name in table.columns if not isinstance(name, str)]
    if names:
        raise RecordingError(FRAME, f"column {names[0]!r}", "its name is not text: rename it")
    return _table(FRAME, {name: _values(table[name]) for name in table.columns})


def _with_index(frame: Any) -> Any:
    """A pandas frame, with its index as columns if the index has names or is a time."""
    names = {name for name in frame.index.names if name is not None}
    is_time = getattr(frame.index.dtype, "kind", "") in "mM"
    return frame.reset_index() if (names or is_time) and not names & {*frame.columns} else frame


def _values(column: Any) -> Any:
    """Values of a column: an array of numbers or times, or a list of anything else."""
    import narwhals as nw

    if isinstance(column.dtype, nw.Datetime) and column.dtype.time_zone is not None:
        # Times of NumPy have no time zone.
        column = column.dt.convert_time_zone("UTC").dt.replace_time_zone(None)
    is_array = column.dtype.is_numeric() or isinstance(column.dtype, nw.Datetime | nw.Duration)
    return column.to_numpy() if is_array else column.to_list()


def table_of_arrays(arrays: Mapping[str, Any]) -> Table:
    """Return arrays of one length as a table; keys are headers, as ``"link_position [deg]"``."""
    columns: dict[str, Any] = {}
    for name, values in _by_header(arrays).items():
        if not isinstance(name, str):
            raise RecordingError(ARRAYS, f"key {name!r}", "it is not text: name the channel")
        columns[name] = _array(name, values)
    return _table(ARRAYS, columns)


def _by_header(arrays: Mapping[str, Any]) -> dict[Any, Any]:
    """Arrays by header; for an `xarray.Dataset` with its coordinates and units."""
    coordinates = {
        name: values for name, values in getattr(arrays, "coords", {}).items() if values.ndim == 1
    }
    found = {}
    for name, values in {**coordinates, **arrays}.items():
        unit = getattr(values, "attrs", {}).get("units")
        has_none = unit and isinstance(name, str) and split_header(name)[1] is None
        found[f"{name} [{unit}]" if has_none else name] = values
    return found


def _array(name: str, values: Any) -> Any:
    if np.ma.is_masked(values):
        reason = "some of its values are masked: remove these samples"
        raise RecordingError(ARRAYS, f"column {name!r}", reason)
    try:
        found = np.asarray(values)
    except ValueError:  # nested lists of different lengths
        found = np.empty((0, 0))
    if found.ndim != 1:
        reason = f"it has {found.ndim} dimensions: give one dimension, with a value for each sample"
        raise RecordingError(ARRAYS, f"column {name!r}", reason)
    return found.tolist() if found.dtype == object else found


def _table(file: str, columns: Mapping[str, Any]) -> Table:
    try:
        known = {
            name: known_times(values) if isinstance(values, np.ndarray) else values
            for name, values in columns.items()
        }
        frame = pl.DataFrame(known, strict=False)
    except (pl.exceptions.PolarsError, TypeError, ValueError) as error:
        what = " ".join(str(error).split())
        reason = f"its columns do not form a table ({what}): give one number for each sample"
        raise RecordingError(file, "", reason) from None
    if not frame.height or not frame.width:
        raise RecordingError(file, "", "it holds no samples: give a value for each sample")
    if frame.height > MOST_ROWS:
        raise RecordingError(
            file,
            "",
            f"it has {frame.height} rows, more than the {MOST_ROWS} that are taken at once: write "
            f"it as a Parquet file and stream that",
        )
    return Table(file, frame, _digest(frame), first_row=0)


def _digest(frame: pl.DataFrame) -> str:
    """Hash of names and values, by which the same log given twice is recognised."""
    digest = hashlib.sha256(repr(frame.schema).encode())
    for column in frame:
        numbers = column.dtype.is_numeric() and not column.null_count()
        digest.update(column.to_numpy().tobytes() if numbers else repr(column.to_list()).encode())
    return digest.hexdigest()


def write_parquet(table: pl.DataFrame, path: Path) -> None:
    """Write a table as Parquet; raise an `OSError` if that fails, as on a full disk."""
    try:
        table.write_parquet(path)
    except pl.exceptions.ComputeError as error:
        reason = str(error).rpartition(": ")[2]
        raise OSError(errno.EIO, reason, str(path)) from None
