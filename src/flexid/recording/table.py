"""From a file's bytes to columns of numbers, every bad cell with its place."""

from __future__ import annotations

import hashlib
import io
import re
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.files import check_file, read_bytes, shown
from flexid.recording.clock import EXAMPLE
from flexid.recording.limits import (
    LARGEST_FILE,
    LARGEST_UNPACKED,
    MOST_CELLS,
    MOST_ROWS,
    check_cells,
)
from flexid.recording.names import cut, first_of, quoted
from flexid.recording.parquet_pages import DamagedError, shape_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    import polars

    from flexid.arrays import FloatArray

LARGE_REMEDY = "identify it as Parquet with --stream, or cut the log into shorter files"
PARQUET_SUFFIXES = (".parquet", ".pq")
WANTED = "a log"
DECIMAL_COMMA = r"^[+-]?\d*,\d+(?:[eEdD][+-]?\d+)?$"
DECIMAL_POINT = r"^[+-]?\d*\.\d+(?:[eEdD][+-]?\d+)?$"
THOUSANDS = r"^[+-]?[1-9]\d{0,2},\d{3}$"
_GROUPED = (  # 1'234.5, 1 234,5, 1,234.5, 1.234,5
    r"[+-]?\d{1,3}(?:(?:[ '\u00a0\u202f]\d{3})+(?:[.,]\d*)?|(?:,\d{3})+\.\d*|(?:\.\d{3})+,\d*)"
)
_DATE = r"\d{4}[-/]\d\d|\d{8}T|\d\d?[-:./]\d\d?[-:./]\d\d|\d+:\d\d|\d+ days? "
_FORTRAN = r"^([^a-zA-Z]*\d)[dD]([+-]?\d+)$"  # 1.5D-03
_TIME_REMEDY = f"the time may be seconds, or stamps such as {EXAMPLE}"
_OTHERS = {  # what else flexid reads, and where it belongs
    ".toml": "this is a TOML file, not a log: a column map is given with --columns",
    ".json": "this is a JSON file, not a log: export the log as CSV or Parquet",
}
_MAGIC = {  # how files begin that are read by the end of their names
    b"PAR1": ("a Parquet file", ".parquet"),
    b"\x89HDF": ("an HDF5 file", ".h5"),
    b"MATLAB 5.0 MAT-file": ("a MATLAB file", ".mat"),
    b"MATLAB 7.3 MAT-file": ("a MATLAB file", ".mat"),
    b"\x89MCAP": ("an MCAP file", ".mcap"),
    b"#ROSBAG V": ("a ROS bag", ".bag"),
    b"SQLite format 3\0": ("a database, perhaps a ROS 2 bag", ".db3"),
    b"MDF     ": ("an MDF file", ".mf4"),
}


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a file, not yet numbers.

    Parameters
    ----------
    file : str
        The file, as its path was given.
    header : str
        Where the names of the columns stand, such as ``"line 1"``.
    first_row : int
        Number of the first row of values, as `row_word` counts.
    row_word : str
        ``"line"`` for a text file, ``"row"`` for Parquet.
    frame : polars.DataFrame
        Text columns of a CSV file, typed columns of a Parquet file.
    sha256 : str
        Digest of the file's bytes.
    warnings : tuple of str
        What was not read of it.
    short : mapping of str to str
        By name of a column, the end of its path by which a channel is recognised.
    kinds : mapping of str to str
        By name of a column, its type and length, for a list of what the file holds.
    """

    file: str
    header: str
    first_row: int
    row_word: str
    frame: polars.DataFrame
    sha256: str
    warnings: tuple[str, ...] = ()
    short: Mapping[str, str] = field(default_factory=dict)
    kinds: Mapping[str, str] = field(default_factory=dict)

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
        return self.short.get(name, name)

    def place(self, index: int, name: str) -> str:
        """Return where the value of column `name` in row `index` (from 0) stands in the file."""
        return f"{self.row_word} {self.first_row + index}, column {name!r}"

    def numbers(self, name: str) -> FloatArray:
        """Return a column as numbers.

        Parameters
        ----------
        name : str
            One of `names`.

        Returns
        -------
        FloatArray, shape (n,)

        Raises
        ------
        RecordingError
            If a cell is empty, is not a number, or is not finite.
        """
        import polars as pl

        column = self.frame[name]
        if column.dtype.is_temporal():
            raise self._not_numeric(name, "dates or times of day")
        if self.row_word == "row" and not column.dtype.is_numeric():
            raise self._not_numeric(name, f"values of type {column.dtype}")
        if column.dtype == pl.String:
            column = column.str.strip_chars()
        numbers = column.cast(pl.Float64, strict=False)
        if column.dtype == pl.String and numbers.null_count() > column.null_count():
            column = column.str.replace(_FORTRAN, "${1}e$2")
            numbers = column.cast(pl.Float64, strict=False)
        if (
            column.dtype == pl.String
            and numbers.null_count() > column.null_count()
            and self.has_decimal_commas
        ):
            pointed = column.str.replace(",", ".", literal=True)
            numbers = pointed.cast(pl.Float64, strict=False)
        values = numbers.to_numpy()
        with np.errstate(all="ignore"):  # of numbers too large to be added
            total = values.sum()
        # It is finite only if all numbers are, and faster than asking each.
        if not (np.isfinite(total) or np.isfinite(values).all()):
            bad = np.flatnonzero(~np.isfinite(values))
            index, more = int(bad[0]), len(bad) - 1
            cell = self.frame[name][index]
            reason = _bad_cell(cell)
            if isinstance(cell, str) and cell.strip() == name:
                reason = "the header stands here once more: remove the line"
            if more and reason.endswith("remove the row"):
                reason += f", and {more} more of the column that are no numbers"
            raise RecordingError(self.file, self.place(index, name), reason)
        return np.require(values, np.float64, "W")

    @cached_property
    def has_decimal_commas(self) -> bool:
        """Whether the numbers of a text have decimal commas.

        No number has a point then, and some commas cannot stand between thousands.
        """
        import polars as pl

        texts = [c.str.strip_chars() for c in self.frame if c.dtype == pl.String]
        if any(text.str.contains(DECIMAL_POINT).any() for text in texts):
            return False
        commas = [text.filter(text.str.contains(DECIMAL_COMMA)) for text in texts]
        return not all(text.str.contains(THOUSANDS).all() for text in commas)

    def _not_numeric(self, name: str, found: str) -> RecordingError:
        remedy = "floating-point numbers"
        if "time" in name.lower():
            remedy = f"seconds since the start, or as stamps such as {EXAMPLE}"
        return RecordingError(
            self.file, f"column {name!r}", f"it holds {found}: write it as {remedy}"
        )


def read_table(path: Path) -> Table:
    """Read a CSV or a Parquet file.

    Parameters
    ----------
    path : Path
        A file whose name ends in ``.parquet`` or ``.pq`` is read as Parquet, any other as text.

    Returns
    -------
    Table

    Raises
    ------
    RecordingError
        If the file is missing, too large, empty, or not what its name says.
    """
    file = shown(path)
    refuse = _refusing(file)
    raw = read_bytes(path, LARGEST_FILE, WANTED, refuse, shorten=LARGE_REMEDY)
    if not raw.strip():
        raise refuse("the file is empty: export the log again")
    digest = hashlib.sha256(raw).hexdigest()
    if path.suffix.lower() in PARQUET_SUFFIXES:
        return _read_parquet(file, raw, digest)
    if path.suffix.lower() in _OTHERS:
        raise refuse(_OTHERS[path.suffix.lower()])
    for magic, (kind, suffix) in _MAGIC.items():
        if raw.startswith(magic):
            raise refuse(f"this is {kind}: rename it so that it ends in {suffix}")
    from flexid.recording.text import read_text

    layout, frame = read_text(file, raw)
    warnings = ()
    if layout.skipped:
        first, last = layout.skipped
        lines = f"line {first} was" if first == last else f"lines {first} to {last} were"
        warnings = (
            f"{file}: {lines} not read, since the column names stand in line {layout.header_line}: "
            f"check that they do",
        )
    return Table(
        file, f"line {layout.header_line}", layout.first_line, "line", frame, digest, warnings
    )


def _refusing(file: str) -> Callable[[str], RecordingError]:
    return lambda reason: RecordingError(file, "", reason)


def scan_parquet(path: Path) -> tuple[polars.LazyFrame, int]:
    """Open a Parquet file of any size.

    Returns
    -------
    frame : polars.LazyFrame
        Its columns, not yet read.
    rows : int
        How many there are.

    Raises
    ------
    RecordingError
        If there is no such file, or it is no Parquet file, or an incomplete or an empty one.
    """
    import polars as pl

    file = shown(path)
    refuse = _refusing(file)
    check_file(path, WANTED, refuse)
    if path.suffix.lower() not in PARQUET_SUFFIXES:
        raise refuse("only a Parquet file can be streamed: write the log as .parquet")
    try:
        with path.open("rb") as opened:
            rows = shape_of(opened).rows
        frame = pl.scan_parquet(path)
        frame.collect_schema()
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, DamagedError) as error:
        raise _broken_parquet(file) from error
    except OSError as error:
        raise refuse(f"the file cannot be read ({error.strerror}): copy it again") from error
    if rows == 0:
        raise RecordingError(file, "", "the file holds no samples: export the log again")
    return frame, rows


def _broken_parquet(file: str) -> RecordingError:
    return RecordingError(
        file, "", "this is no readable Parquet file: export it again, or name it .csv if it is text"
    )


def _read_parquet(file: str, raw: bytes, digest: str) -> Table:
    import polars as pl

    try:
        shape = shape_of(io.BytesIO(raw))
        if shape.rows > MOST_ROWS:
            raise RecordingError(
                file,
                "",
                f"the file has {shape.rows} rows, more than the {MOST_ROWS} that are read at once: "
                f"identify it with --stream, or cut the log into shorter files",
            )
        check_cells(file, shape.rows, shape.columns)
        if shape.values > MOST_CELLS or shape.unpacked > LARGEST_UNPACKED:
            raise RecordingError(
                file,
                "",
                f"unpacked it has {shape.unpacked / 1e9:.2g} GB of {shape.values} values, more "
                f"than are read at once: write the columns of one joint",
            )
        frame = pl.read_parquet(io.BytesIO(raw))
    except (
        pl.exceptions.PolarsError,
        pl.exceptions.PanicException,
        DamagedError,
        OSError,
    ) as error:
        raise _broken_parquet(file) from error
    if frame.width == 0 or frame.height == 0:
        raise RecordingError(file, "", "the file holds no samples: export the log again")
    return Table(file, "", 1, "row", frame, digest)


def _bad_cell(cell: object) -> str:
    """Say what is wrong with a cell that is no finite number."""
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        return "the cell is empty: fill it in, or remove the row"
    text = str(cell).strip()
    cut = text if len(text) <= 24 else text[:21] + "..."
    if re.fullmatch(DECIMAL_COMMA, text):
        return (
            f"{cut!r} has a comma, and it cannot be known whether that of a decimal or between "
            f"thousands: export with decimal points"
        )
    with suppress(ValueError):
        if not np.isfinite(float(text)):
            return f"{cut} is not a finite number: remove the row"
    if re.fullmatch(_GROUPED, text):
        return f"{cut!r} has marks between its thousands: export numbers without"
    if re.match(_DATE, text):
        return f"{cut!r} is a date or a time of day, and no number: {_TIME_REMEDY}"
    return f"{cut!r} is not a number: correct it, or remove the row"
