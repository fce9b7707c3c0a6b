"""MATLAB files, by SciPy; those of version 7.3 are HDF5."""

from pathlib import Path
from typing import Any

import numpy as np

from flexid.readers import hdf5
from flexid.readers.arrays import Arrays
from flexid.readers.contents import DEEPEST, WIDEST, Contents, RefusedError

_HDF5 = (b"MATLAB 7.3", b"\x89HDF")
_NAMES = ("label", "Name", "name")
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
    elif names is None and array.dtype != object:
        found.add(path, array.shape, array.dtype, array.__getitem__)
    elif array.size > WIDEST:
        found.others[path] = f"{array.size} structs or cells"
    else:
        elements = array.ravel(order="F")
        own = [_own_name(one) if names else "" for one in elements]
        for number, one in enumerate(elements):
            where = path if array.size == 1 and names else path + found.index(number)
            if own[number] and own.count(own[number]) == 1:
                where = f"{path}.{own[number]}"
            if names is None:
                _add(found, where, one, depth + 1)
            for name in names or ():
                _add(found, f"{where}.{name}", one[name], depth + 1)


def _own_name(struct: Any) -> str:
    """What a struct is called by a field of its own, as one of a simulation's signals is."""
    one = np.asarray(struct)
    if one.size != 1:
        return ""
    fields = [field for field in _NAMES if field in (one.dtype.names or ())]
    texts = [np.asarray(one.reshape(-1)[0][field]) for field in fields]
    words = [
        str(text.reshape(-1)[0]).strip() for text in texts if text.size and text.dtype.kind == "U"
    ]
    return next((word for word in words if word), "")
