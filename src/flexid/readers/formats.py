"""The formats of other programs that flexid reads, and the words for them."""

import os
from pathlib import Path
from typing import NamedTuple


class Format(NamedTuple):
    """A format that a library reads."""

    name: str  # in a list of formats
    what: str  # one such file, with its article
    suffixes: tuple[str, ...]  # ends of the files' names
    module: str  # whose function `read` reads them
    magic: tuple[bytes, ...] = ()  # how the files begin
    extra: str = ""  # of flexid, which installs the library
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
"""Usual ends of the names of text files, which are read without a library."""


def format_of(path: Path) -> Format | None:
    """The format of a file, or of the first log in a folder; None for text.

    >>> from pathlib import Path
    >>> format_of(Path("run.H5")).name, format_of(Path("run.csv"))
    ('HDF5', None)
    """
    if os.path.isdir(path):
        return _of_suffix(files_of(path)[0].suffix, in_folder=True)
    return _of_suffix(path.suffix)


def files_of(path: Path) -> list[Path]:
    """The files of a log: itself, or those of one format in a folder."""
    if not os.path.isdir(path):
        return [path]
    inside = sorted(path.iterdir())
    for one in FORMATS:
        files = [file for file in inside if one.in_folder and file.suffix in one.suffixes]
        if files:
            return files
    return [path]


def suffixes() -> tuple[str, ...]:
    """Ends of the names of all files that are read, text first."""
    return (*TEXT_SUFFIXES, *(suffix for one in FORMATS for suffix in one.suffixes))


def kinds() -> str:
    """All formats as a list for a sentence.

    >>> kinds().startswith("CSV, Parquet, MATLAB, HDF5, ")
    True
    """
    names = ["CSV", *(one.name for one in FORMATS)]
    return f"{', '.join(names[:-1])} or {names[-1]}"


def looks_like(raw: bytes) -> Format | None:
    """The format whose files begin as some bytes do."""
    return next((one for one in FORMATS if raw.startswith(one.magic or (b"\0" * 99,))), None)


def _of_suffix(suffix: str, *, in_folder: bool = False) -> Format | None:
    for one in FORMATS:
        if suffix.lower() in one.suffixes and (one.in_folder or not in_folder):
            return one
    return None
