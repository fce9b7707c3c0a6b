"""Arrays of a file as signals: vectors, columns of matrices, and the times beside them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from flexid.recording.names import usual_channel
from flexid.recording.series import LONGEST_PATH, Series

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Selection: TypeAlias = tuple[int | slice, ...]
    Read: TypeAlias = Callable[[Selection], NDArray[np.generic]]

WIDEST = 64
"""Columns of a matrix that are signals each; one that has more is an image or a map."""

_ALL = slice(None)


class Arrays:
    """What was found in a file of arrays.

    Parameters
    ----------
    brackets : str
        Between which indices stand: ``"()"`` where the format counts from 1, as MATLAB does, and
        ``"[]"`` where it counts from 0.
    """

    def __init__(self, brackets: str) -> None:
        self.series: list[Series] = []
        self.others: dict[str, str] = {}
        self._part = _ALL
        self._brackets = brackets
        self._first = int(brackets == "()")

    def index(self, position: int) -> str:
        """An index in a path, from its position from 0."""
        return f"{self._brackets[0]}{position + self._first}{self._brackets[1]}"

    def add(
        self, path: str, shape: tuple[int, ...], dtype: np.dtype, read: Read, unit: str = ""
    ) -> None:
        """Add an array; what is no signal is only listed."""
        sizes = [size for size in shape if size != 1]
        size = " × ".join(map(str, shape)) or "one value"
        if len(path) > LONGEST_PATH:
            self.others[path[:LONGEST_PATH]] = "a path too long to be named"
        elif dtype.kind not in "iuf" or not sizes or len(sizes) > 2 or 0 in sizes:
            self.others[path] = f"{_type_name(dtype)}, {size}"
        elif len(sizes) == 1:
            along = shape.index(sizes[0])
            selection = tuple(_ALL if axis == along else 0 for axis in range(len(shape)))
            self._one(path, sizes[0], dtype, read, selection, unit)
        elif min(sizes) > WIDEST:
            self.others[path] = f"{_type_name(dtype)}, {size}"
        else:
            self._columns(path, shape, dtype, read, unit)

    def _columns(
        self, path: str, shape: tuple[int, ...], dtype: np.dtype, read: Read, unit: str
    ) -> None:
        """A matrix, whose longer side is time."""
        first, second = (axis for axis, size in enumerate(shape) if size != 1)
        along, across = (first, second) if shape[first] >= shape[second] else (second, first)
        for position in range(shape[across]):
            number = str(position + self._first)
            indices = ":," + number if along == first else number + ",:"
            selection = tuple(
                _ALL if axis == along else position if axis == across else 0
                for axis in range(len(shape))
            )
            name = f"{path}{self._brackets[0]}{indices}{self._brackets[1]}"
            self._one(name, shape[along], dtype, read, selection, unit)

    def _one(
        self, path: str, length: int, dtype: np.dtype, read: Read, selection: Selection, unit: str
    ) -> None:
        def values() -> NDArray[np.generic]:
            return read(tuple(self._part if one == _ALL else one for one in selection))

        self.series.append(Series(path, dtype.name, length, values, unit))

    def parts(self, chosen: Collection[Series], size: int) -> Iterator[tuple[float, float]]:
        """Let values be those of one part after the other, see `SeriesFile`."""
        length = max((series.length for series in chosen), default=0)
        for start in range(0, length, size):
            self._part = slice(start, start + size)
            yield -np.inf, np.inf

    def with_clocks(self) -> tuple[Series, ...]:
        """The signals, each with the path of the times that stand nearest to it."""
        clocks: dict[str, list[str]] = {}
        for series in self.series:
            folder, name = _split(series.path)
            usual = usual_channel(name)
            if usual is not None and usual[0] == "time":
                clocks.setdefault(folder, []).append(series.path)
        return tuple(replace(one, clock=_nearest(one.path, clocks)) for one in self.series)


def _nearest(path: str, clocks: dict[str, list[str]]) -> str:
    folder = path
    while folder:
        folder, _ = _split(folder)
        if folder in clocks:
            return clocks[folder][0] if len(clocks[folder]) == 1 else ""
    return ""


def _split(path: str) -> tuple[str, str]:
    """The path of what an array stands in, and its own name."""
    at = max(path.rfind("/"), path.rfind("."))
    return (path[:at], path[at + 1 :]) if at >= 0 else ("", path)


def _type_name(dtype: np.dtype) -> str:
    return {"U": "text", "S": "text", "O": "text or objects", "b": "logical"}.get(
        dtype.kind, dtype.name
    )
