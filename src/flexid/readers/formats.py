"""Formats of other programs that flexid reads, and the types that their readers return."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

if TYPE_CHECKING:
    import polars

Frame: TypeAlias = "tuple[str, Mapping[str, Any] | polars.DataFrame]"
Read: TypeAlias = Callable[[Collection[str], int], Iterator[Frame]]

STAMPS = ""  # name of the column of time stamps in a frame: seconds, or whole nanoseconds
WIDEST = 64  # columns of a matrix of signals; a wider one is an image or a map


class Series(NamedTuple):
    """A signal of a file."""

    path: str  # its place in the file, and its name in a column map
    kind: str  # type of its values, for messages
    length: int
    unit: str = ""  # as the file states it
    clock: str = ""  # name of the clock of its time stamps; empty if the time is a signal
    is_twin: bool = False  # whether another time of the file is equal, as each timeseries has one


@dataclass(frozen=True, eq=False)
class Contents:
    """Contents of a file.

    `read` is called with the paths of signals and a number of values. It yields frames of about
    that many values, each with the name of its clock. A frame has values by path and, if there are
    clocks, time stamps under `STAMPS`.
    """

    series: list[Series]
    read: Read
    others: Mapping[str, str] = field(default_factory=dict)  # reason by path of what is no signal
    notes: Mapping[str, str] = field(default_factory=dict)  # warning by clock, if it is used
    is_table: bool = False  # whether the signals are the columns of one table


class RefusedError(Exception):
    """A file is refused: the place in it (empty for all of it), and the reason with the remedy."""

    def __init__(self, place: str, reason: str) -> None:
        self.place, self.reason = place, reason
        super().__init__(reason)


def of_frame(frame: polars.DataFrame | polars.LazyFrame) -> Contents:
    """Return a frame, which may be lazy, as the contents of a file."""
    import polars as pl

    lazy = frame.lazy()
    rows = lazy.select(pl.len()).collect().item()
    series = [Series(path, str(kind), rows) for path, kind in lazy.collect_schema().items()]

    def read(paths: Collection[str], size: int) -> Iterator[Frame]:
        # Polars reads ahead by some batches and then waits, so that memory stays bounded.
        for batch in lazy.select(paths).collect_batches(chunk_size=size):
            yield "", batch

    return Contents(series, read, is_table=True)


class Format(NamedTuple):
    """A file format that a library reads."""

    name: str  # for a list of formats
    what: str  # a file of the format, with its article
    suffixes: tuple[str, ...]  # of the names of files
    module: str  # with the function `read`
    magic: tuple[bytes, ...] = ()  # first bytes of the files
    extra: str = ""  # extra of flexid that installs the library
    in_folder: bool = False  # whether a folder of such files is one log


_HERE = __name__.rpartition(".")[0]
_MATLAB = (b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file")

PARQUET = Format("Parquet", "a Parquet file", (".parquet", ".pq"), f"{_HERE}.parquet", (b"PAR1",))
FORMATS = [
    PARQUET,
    Format("MATLAB", "a MATLAB file", (".mat",), f"{_HERE}.matlab_hdf5", _MATLAB, "hdf5"),
    Format("HDF5", "an HDF5 file", (".h5", ".hdf5"), f"{_HERE}.matlab_hdf5", (b"\x89HDF",), "hdf5"),
    Format("NumPy", "a NumPy file", (".npz", ".npy"), f"{_HERE}.arrays", (b"\x93NUMPY",)),
    Format("MDF", "an MDF file", (".mf4", ".mdf"), f"{_HERE}.mdf", (b"MDF     ",), "mdf"),
    Format("MCAP", "an MCAP file", (".mcap",), f"{_HERE}.ros", (b"\x89MCAP",), "ros", True),
    Format("ROS 1 bag", "a ROS 1 bag", (".bag",), f"{_HERE}.ros", (b"#ROSBAG V",), "ros"),
    Format("ROS 2 bag", "a ROS 2 bag", (".db3",), f"{_HERE}.ros", (b"SQLite form",), "ros", True),
]
TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat", ".log")
"""Common suffixes of text files, which are read without a library."""


def format_of(path: Path) -> Format | None:
    """Return the format of a file, or of the first log in a folder; None for text.

    >>> from pathlib import Path
    >>> format_of(Path("run.H5")).name, format_of(Path("run.csv"))
    ('HDF5', None)
    """
    is_folder, suffix = os.path.isdir(path), files_of(path)[0].suffix.lower()
    found = (one for one in FORMATS if suffix in one.suffixes and (one.in_folder or not is_folder))
    return next(found, None)


def files_of(path: Path) -> list[Path]:
    """Return the files of a log: the file itself, or those of one format in a folder."""
    if not os.path.isdir(path):
        return [path]
    inside = sorted(path.iterdir())
    for one in FORMATS:
        files = [file for file in inside if one.in_folder and file.suffix in one.suffixes]
        if files:
            return files
    return [path]


def suffixes() -> tuple[str, ...]:
    """Return the suffixes of all files that are read, text first."""
    return (*TEXT_SUFFIXES, *(suffix for one in FORMATS for suffix in one.suffixes))


def kinds() -> str:
    """Return the names of all formats as a list for a sentence."""
    names = ["CSV", *(one.name for one in FORMATS)]
    return f"{', '.join(names[:-1])} or {names[-1]}"


def looks_like(raw: bytes) -> Format | None:
    """Return the format of a file by its first bytes, or None."""
    return next((one for one in FORMATS if raw.startswith(one.magic)), None)
