"""Arrays of a file as signals: vectors, and columns of matrices."""

from collections.abc import Callable, Collection, Iterator, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexid.readers.contents import (
    LONGEST_PATH,
    MOST_SIGNALS,
    WIDEST,
    Contents,
    Frame,
    RefusedError,
    Series,
)

Selection: TypeAlias = tuple[int | slice, ...]
Values: TypeAlias = Callable[[Selection], NDArray[np.generic]]

_ALL = slice(None)
_SIGNALS = "iufmM"  # kinds of numbers, dates and durations
_RESOLUTIONS = ("[D]", "[ms]", "[us]", "[ns]")  # of dates and durations, that Polars knows


class Arrays:
    """What was found in a file of arrays.

    Indices stand in ``()`` where the format counts from 1, as MATLAB does, and else in ``[]``.
    """

    def __init__(self, brackets: str) -> None:
        self.others: dict[str, str] = {}
        self._series: dict[str, Series] = {}
        self._values: dict[str, tuple[Values, Selection]] = {}
        self._brackets = brackets
        self._first = int(brackets == "()")

    def index(self, position: int) -> str:
        """An index in a path, from its position from 0."""
        return f"{self._brackets[0]}{position + self._first}{self._brackets[1]}"

    def add(
        self,
        path: str,
        shape: tuple[int, ...],
        dtype: np.dtype,
        values: Values,
        unit: str = "",
        names: Sequence[str] = (),  # of a matrix's columns
    ) -> None:
        """Add an array, of which `values` reads a selection; what is no signal is only listed."""
        long = [axis for axis, size in enumerate(shape) if size != 1]
        if len(path) > LONGEST_PATH:
            self.others[path[:LONGEST_PATH]] = "a path too long to be named"
        elif dtype.kind not in _SIGNALS or not 1 <= len(long) <= 2 or 0 in shape:
            self.others[path] = f"{_kind(dtype)}, {_size(shape)}"
        elif len(long) == 1:
            self._add(path, shape, long[0], {}, dtype, values, unit)
        elif min(shape[axis] for axis in long) > WIDEST:
            self.others[path] = f"{_kind(dtype)}, {_size(shape)}"
        else:  # of a matrix the longer side is time
            first, second = long
            along, across = (first, second) if shape[first] >= shape[second] else (second, first)
            for position in range(shape[across]):
                number = str(position + self._first)
                name = f":,{number}" if along == first else f"{number},:"
                name = f"{path}{self._brackets[0]}{name}{self._brackets[1]}"
                if len({*names}) == shape[across]:
                    name = f"{path}.{names[position]}"
                self._add(name, shape, along, {across: position}, dtype, values, unit)
        if len(self._series) > MOST_SIGNALS:
            raise RefusedError("", "it holds too many signals: write those of one joint")

    def contents(self) -> Contents:
        """All of it."""
        return Contents([*self._series.values()], self._read, self.others)

    def _add(
        self,
        path: str,
        shape: tuple[int, ...],
        along: int,
        at: dict[int, int],
        dtype: np.dtype,
        values: Values,
        unit: str,
    ) -> None:
        where = tuple(_ALL if axis == along else at.get(axis, 0) for axis in range(len(shape)))
        self._series[path] = Series(path, dtype.name, shape[along], unit)
        self._values[path] = values, where

    def _read(self, paths: Collection[str], size: int) -> Iterator[Frame]:
        length = max((self._series[path].length for path in paths), default=0)
        for start in range(0, length, size):
            part = slice(start, start + size)
            yield (
                "",
                {
                    path: known_times(path, read(tuple(part if at == _ALL else at for at in where)))
                    for path, (read, where) in ((path, self._values[path]) for path in paths)
                },
            )


def known_times(name: str, values: NDArray[np.generic]) -> NDArray[np.generic]:
    """An array whose dates and durations, if it holds any, have a resolution that Polars knows."""
    kind, resolution = values.dtype.kind, values.dtype.str[4:]
    if kind not in "mM" or resolution in _RESOLUTIONS:
        return values
    place = f"column {name!r}"
    if not resolution:
        raise RefusedError(place, "its durations have no unit: give seconds as numbers")
    times = values.astype(f"{kind}8[ns]")
    # What 64 bits cannot hold as nanoseconds comes out as another second.
    given, kept = (each.astype(f"{kind}8[s]").astype("i8") for each in (values, times))
    if not (given == kept).all():
        reason = "its times are more than 292 years from 1970: give seconds as numbers"
        raise RefusedError(place, reason)
    return times


def _size(shape: tuple[int, ...]) -> str:
    return " × ".join(map(str, shape)) or "one value"


def _kind(dtype: np.dtype) -> str:
    words = {"U": "text", "S": "text", "O": "text or objects", "b": "logical"}
    return words.get(dtype.kind, dtype.name)
