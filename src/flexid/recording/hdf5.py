"""HDF5 files, and MATLAB's of version 7.3, which are such: by h5py."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.errors import RecordingError
from flexid.files import shown
from flexid.recording.arrays import Arrays
from flexid.recording.limits import MOST_COLUMNS
from flexid.recording.outside import digest_of, need, readable
from flexid.recording.series import SeriesFile

if TYPE_CHECKING:
    from pathlib import Path

    import h5py

    from flexid.recording.arrays import Read

_WHAT = "HDF5 file"
_MOST_OBJECTS = 100_000
_MATLABS_OWN = ("#refs#", "#subsystem#")
_PLAIN = {"double", "single"} | {f"{u}int{n}" for u in ("", "u") for n in (8, 16, 32, 64)}


def open_series(path: Path) -> SeriesFile:
    """The signals of an HDF5 file: vectors, columns of matrices, fields of tables.

    A dataset's unit is its attribute ``units`` or ``unit``. Links to other files are not followed.

    Raises
    ------
    RecordingError
        If it is no HDF5 file, a damaged one, or h5py is not installed.
    """
    file = shown(path)
    digest = digest_of(path)
    need(file, "h5py", "hdf5")
    with path.open("rb") as opened:
        is_matlab = opened.read(6) == b"MATLAB"
    with readable(file, _WHAT):
        import h5py

        found = Arrays("()" if is_matlab else "[]")
        with h5py.File(path, "r") as content:
            _visit(file, content, found, path, is_matlab=is_matlab)
    return SeriesFile(file, digest, found.with_clocks(), found.others, parts=found.parts)


def _visit(file: str, content: h5py.File, found: Arrays, path: Path, *, is_matlab: bool) -> None:
    """Add every dataset."""
    import h5py

    objects = 0

    def visit(name: str, one: Any) -> bool | None:
        nonlocal objects
        objects += 1
        if objects > _MOST_OBJECTS or len(found.series) > MOST_COLUMNS:
            return True
        if is_matlab and name.startswith(_MATLABS_OWN):
            return None
        shown_name = name.replace("/", ".") if is_matlab else name
        if isinstance(one, h5py.Dataset):
            if one.is_virtual or one.external:
                found.others[shown_name] = "its values stand in another file, which is not read"
            elif is_matlab:
                _add_matlab(found, shown_name, one, path)
            else:
                _add(found, shown_name, one, path)
        return None

    if content.visititems(visit):
        raise RecordingError(file, "", "it holds too many signals: write those of one joint")


def _add(found: Arrays, name: str, dataset: h5py.Dataset, path: Path) -> None:
    unit = _unit(dataset)
    if dataset.dtype.names is None:
        read = _reader(path, dataset.name)
        found.add(name, dataset.shape or (), dataset.dtype, read, unit)
        return
    for field in dataset.dtype.names:
        read = _reader(path, dataset.name, field)
        found.add(f"{name}.{field}", dataset.shape, dataset.dtype[field], read)


def _add_matlab(found: Arrays, name: str, dataset: h5py.Dataset, path: Path) -> None:
    """A variable, of which HDF5 has the dimensions in the opposite order."""
    kind = dataset.attrs.get("MATLAB_class", b"")
    kind = kind.decode(errors="replace") if isinstance(kind, bytes) else str(kind)
    if kind not in _PLAIN or dataset.shape is None:
        found.others[name] = f"{kind or 'an object'}: save its values as arrays"
        return
    read = _reader(path, dataset.name)
    found.add(name, dataset.shape[::-1], dataset.dtype, lambda picked: read(picked[::-1]))


def _reader(path: Path, name: str | None, field: str | None = None) -> Read:
    """Read a part of a dataset when it is wanted."""

    def read(selection: tuple[int | slice, ...]) -> np.ndarray:
        with readable(shown(path), _WHAT):
            import h5py

            with h5py.File(path, "r") as content:
                dataset: Any = content[str(name)]
                if field is not None:
                    dataset = dataset.fields(field)
                return np.asarray(dataset[selection])

    return read


def _unit(dataset: h5py.Dataset) -> str:
    for key in ("units", "unit"):
        value = dataset.attrs.get(key)
        text = value.decode(errors="replace") if isinstance(value, bytes) else value
        if isinstance(text, str):
            return text.strip().strip("[]()")
    return ""
