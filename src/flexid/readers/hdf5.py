"""HDF5 files, and MATLAB's of version 7.3, which are such, by h5py."""

from pathlib import Path
from typing import Any

from flexid.readers.arrays import Arrays
from flexid.readers.child import still_alive
from flexid.readers.contents import WIDEST, Contents, RefusedError

_MOST_OBJECTS = 100_000
_OF_COLUMNS = ("columns", "names", "column_names", "labels", "fields", "channels")
_MATLABS_OWN = ("#refs#", "#subsystem#")
_PLAIN = {"double", "single"} | {f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)}


def read(path: Path) -> Contents:
    """The signals of an HDF5 file: vectors, columns of matrices, fields of tables.

    A dataset's unit is its attribute ``units`` or ``unit``. Links to other files are not followed.
    """
    import h5py

    with path.open("rb") as opened:
        is_matlab = opened.read(6) == b"MATLAB"
    found = Arrays("()" if is_matlab else "[]")
    objects = 0

    def visit(name: str, one: Any) -> bool | None:
        nonlocal objects
        objects += 1
        still_alive()
        if objects > _MOST_OBJECTS:
            return True
        name = name.replace("/", ".") if is_matlab else name
        if not isinstance(one, h5py.Dataset) or (is_matlab and name.startswith(_MATLABS_OWN)):
            return None
        if one.is_virtual or one.external:
            found.others[name] = "its values stand in another file, which is not read"
        else:
            (_add_matlab if is_matlab else _add)(found, name, file[one.name])
        return None

    file = h5py.File(path, "r")
    if file.visititems(visit):
        raise RefusedError("", "it holds too many signals: write those of one joint")
    return found.contents()


def _add(found: Arrays, name: str, dataset: Any) -> None:
    """A dataset, or the fields of a table."""
    if dataset.dtype.names is None:
        unit = _text(dataset.attrs.get("units") or dataset.attrs.get("unit")).strip()
        values = dataset.__getitem__
        shape, names = dataset.shape or (), _names_of_columns(dataset)
        found.add(name, shape, dataset.dtype, values, unit.strip("[]()"), names)
        return
    for field in dataset.dtype.names:
        values = dataset.fields(field).__getitem__
        found.add(f"{name}.{field}", dataset.shape, dataset.dtype[field], values)


def _names_of_columns(dataset: Any) -> list[str]:
    """Names of a matrix's columns: in an attribute, or beside it as pandas writes them."""
    beside = dataset.name.removesuffix("_values") + "_items"
    named = [dataset.attrs[key] for key in _OF_COLUMNS if key in dataset.attrs]
    if not named and dataset.name.endswith("_values") and beside in dataset.file:
        items = dataset.file[beside]
        named = [items[:]] if items.ndim == 1 and items.size <= WIDEST else []
    names = list(named[0]) if named and getattr(named[0], "ndim", 0) == 1 else []
    return [text for one in names if (text := _text(one).strip())]


def _add_matlab(found: Arrays, name: str, dataset: Any) -> None:
    """A variable, of which HDF5 has the dimensions in the opposite order."""
    kind = _text(dataset.attrs.get("MATLAB_class"))
    if kind not in _PLAIN or dataset.shape is None:
        found.others[name] = f"{kind or 'an object'}: save its values as arrays"
        return
    found.add(name, dataset.shape[::-1], dataset.dtype, lambda picked: dataset[picked[::-1]])


def _text(value: Any) -> str:
    value = value.decode(errors="replace") if isinstance(value, bytes) else value
    return value if isinstance(value, str) else ""
