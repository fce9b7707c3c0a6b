"""MATLAB files, by SciPy; those of version 7.3 are HDF5."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.readers import hdf5
from flexid.readers.arrays import Arrays
from flexid.readers.contents import DEEPEST, WIDEST, Contents, RefusedError

if TYPE_CHECKING:
    from pathlib import Path

_HDF5 = (b"MATLAB 7.3", b"\x89HDF")
_OBJECTS = ("MatlabOpaque", "MatlabFunction", "MatlabObject")


def read(path: Path) -> Contents:
    """The signals of a MATLAB file: vectors, columns of matrices, and those in structs."""
    with path.open("rb") as opened:
        if opened.read(16).startswith(_HDF5):
            return hdf5.read(path)
    from scipy.io import loadmat

    found = Arrays("()")
    for name, value in loadmat(path).items():
        if not name.startswith("__"):
            _add(found, name, value, 0)
    return found.contents()


def _add(found: Arrays, path: str, value: Any, depth: int) -> None:
    """Add a variable, or a field of a struct."""
    if depth > DEEPEST:
        raise RefusedError("", "its structs are nested too deep: save the signals of one joint")
    array = np.asarray(value)
    names = array.dtype.names
    if type(value).__name__ in _OBJECTS:
        found.others[path] = "an object: save its Time and Data as arrays"
    elif names is None:
        found.add(path, array.shape, array.dtype, array.__getitem__)
    elif array.size > WIDEST:
        found.others[path] = f"{array.size} structs"
    else:
        for number, one in enumerate(array.ravel(order="F")):
            where = path if array.size == 1 else path + found.index(number)
            for name in names:
                _add(found, f"{where}.{name}", one[name], depth + 1)
