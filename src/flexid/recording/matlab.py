"""MATLAB files: through SciPy, and those of version 7.3, which are HDF5, as such."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.errors import RecordingError
from flexid.files import shown
from flexid.recording.arrays import WIDEST, Arrays
from flexid.recording.hdf5 import open_series as open_hdf5
from flexid.recording.limits import LARGEST_FILE, LARGEST_UNPACKED, MOST_COLUMNS
from flexid.recording.matlab_elements import TooLargeError, check_elements
from flexid.recording.outside import DEEPEST, OutsideFile, digest_of, readable
from flexid.recording.series import SeriesFile

if TYPE_CHECKING:
    from pathlib import Path

_WHAT = "MATLAB file"
_VERSION_73 = b"MATLAB 7.3"
_HDF5 = b"\x89HDF"
_HEADER = 128  # bytes before the first element
_REMEDY = "save its Time and Data as arrays"


def open_series(path: Path) -> SeriesFile:
    """The signals of a MATLAB file: vectors, columns of matrices, and those in structs.

    Raises
    ------
    RecordingError
        If it is no MATLAB file, or one that is damaged or too large.
    """
    file = shown(path)
    digest = digest_of(path)
    with path.open("rb") as opened:
        head = opened.read(_HEADER)
    if head.startswith((_VERSION_73, _HDF5)):
        return open_hdf5(path)
    digest_of(path, LARGEST_FILE)
    with readable(file, _WHAT):
        from scipy.io import loadmat

        _check(path)
        with OutsideFile(path) as opened:
            content = loadmat(opened)
        found = Arrays("()")
        for name, value in content.items():
            if not name.startswith("__"):
                _add(file, found, name, value, 0)
    return SeriesFile(file, digest, found.with_clocks(), found.others)


def _add(file: str, found: Arrays, path: str, value: Any, depth: int) -> None:
    """Add a variable, or a field of a struct."""
    if len(found.series) > MOST_COLUMNS or depth > DEEPEST:
        raise RecordingError(
            file, "", "it holds too many signals, or too deep: save the signals of one joint"
        )
    array = np.asarray(value)
    names = array.dtype.names
    if type(value).__name__ in ("MatlabOpaque", "MatlabFunction", "MatlabObject"):
        found.others[path] = f"an object: {_REMEDY}"
    elif names is None:
        found.add(path, array.shape, array.dtype, lambda selection: array[selection])
    elif array.size > WIDEST:
        found.others[path] = f"{array.size} structs"
    else:
        for number, one in enumerate(array.ravel(order="F")):
            where = path if array.size == 1 else path + found.index(number)
            for name in names:
                _add(file, found, f"{where}.{name}", one[name], depth + 1)


def _check(path: Path) -> None:
    """Raise if the file would not fit into memory, or SciPy could not bear it."""
    try:
        check_elements(path)
    except TooLargeError:
        raise RecordingError(
            shown(path),
            "",
            f"unpacked it is larger than {LARGEST_UNPACKED / 1e9:g} GB, the most "
            f"that is read: save the signals of one joint",
        ) from None
