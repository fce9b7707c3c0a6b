"""Reader of HDF5 and MATLAB 7.3 files by h5py, and of older MATLAB files by SciPy."""

from pathlib import Path
from typing import Any

import numpy as np

from flexid.readers.arrays import Arrays
from flexid.readers.formats import WIDEST, Contents

_MATLABS_OWN = ("#refs#", "#subsystem#")
_PLAIN = {"double", "single"} | {f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)}
_OBJECTS = ("MatlabOpaque", "MatlabFunction", "MatlabObject")


def read(path: Path) -> Contents:
    """Return the signals of a file: vectors, columns of matrices, fields of tables and structs.

    The unit of an HDF5 dataset is its attribute ``units`` or ``unit``. Links to other files are not
    followed.
    """
    with path.open("rb") as opened:
        begin = opened.read(16)
    is_matlab = begin.startswith(b"MATLAB")
    is_hdf5 = path.suffix.lower() != ".mat" or begin.startswith((b"MATLAB 7.3", b"\x89HDF"))
    found = Arrays("()" if is_matlab or not is_hdf5 else "[]")
    if is_hdf5:
        _add_hdf5(found, path, is_matlab=is_matlab)
        return found.contents()
    from scipy.io import loadmat

    for name, value in loadmat(path).items():
        if not name.startswith("__"):
            _add_variable(found, name, value)
    return found.contents()


def _add_hdf5(found: Arrays, path: Path, *, is_matlab: bool) -> None:
    """Add the datasets of all groups."""
    import h5py

    def visit(name: str, one: Any) -> None:
        name = name.replace("/", ".") if is_matlab else name
        if not isinstance(one, h5py.Dataset) or (is_matlab and name.startswith(_MATLABS_OWN)):
            return
        if one.is_virtual or one.external:
            found.others[name] = "its values are in another file, which is not read"
        else:
            (_add_matlab if is_matlab else _add)(found, name, file[one.name])

    file = h5py.File(path, "r")
    file.visititems(visit)


def _add(found: Arrays, name: str, dataset: Any) -> None:
    """Add a dataset, or the fields of a table."""
    if dataset.dtype.names is None:
        unit = _text(dataset.attrs.get("units") or dataset.attrs.get("unit")).strip()
        values = dataset.__getitem__
        found.add(name, dataset.shape or (), dataset.dtype, values, unit.strip("[]()"))
        return
    for field in dataset.dtype.names:
        values = dataset.fields(field).__getitem__
        found.add(f"{name}.{field}", dataset.shape, dataset.dtype[field], values)


def _text(value: Any) -> str:
    value = value.decode(errors="replace") if isinstance(value, bytes) else value
    return value if isinstance(value, str) else ""


def _add_matlab(found: Arrays, name: str, dataset: Any) -> None:
    """Add a MATLAB variable; HDF5 stores its dimensions in reverse order."""
    kind = _text(dataset.attrs.get("MATLAB_class"))
    if kind not in _PLAIN or dataset.shape is None:
        found.others[name] = f"{kind or 'an object'}: save its values as arrays"
        return
    found.add(name, dataset.shape[::-1], dataset.dtype, lambda picked: dataset[picked[::-1]])


def _add_variable(found: Arrays, path: str, value: Any) -> None:
    """Add a variable of an older MATLAB version, or a field of a struct."""
    array = np.asarray(value)
    names = array.dtype.names
    if type(value).__name__ in _OBJECTS:
        found.others[path] = "an object: save its Time and Data as arrays"
    elif array.dtype.kind == "U" and array.size == 1:  # such as a signal label of Simulink
        found.others[path] = f"text {array.item()[:60]!r}"
    elif names is None and array.dtype != object:
        found.add(path, array.shape, array.dtype, array.__getitem__)
    elif array.size > WIDEST:
        found.others[path] = f"{array.size} structs or cells"
    else:
        for number, one in enumerate(array.ravel(order="F")):
            where = path if array.size == 1 and names else path + found.index(number)
            if names is None:
                _add_variable(found, where, one)
            for name in names or ():
                _add_variable(found, f"{where}.{name}", one[name])
