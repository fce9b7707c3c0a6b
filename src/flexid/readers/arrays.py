"""Arrays of a file as signals (vectors and columns of matrices), and the reader of NumPy files."""

import re
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexid.readers.formats import WIDEST, Contents, Frame, Series

Selection: TypeAlias = tuple[int | slice, ...]
Values: TypeAlias = Callable[[Selection], NDArray[np.generic]]

_ALL = slice(None)
_SIGNALS = "iufmM"  # kinds of NumPy: integers, floating-point numbers, durations and dates
_WORDS = {"U": "text", "S": "text", "O": "text or objects", "b": "logical"}


class Arrays:
    """Signals found in a file of arrays.

    Indices are in ``()`` if the format counts from 1, as MATLAB, and in ``[]`` otherwise.
    """

    def __init__(self, brackets: str) -> None:
        self.others: dict[str, str] = {}
        self._found: dict[str, tuple[Series, Values, Selection]] = {}
        self._brackets = brackets
        self._first = int(brackets == "()")

    def index(self, position: int | str) -> str:
        """Return a bracketed index for a path, from a position that counts from 0, or a text."""
        index = position if isinstance(position, str) else position + self._first
        return f"{self._brackets[0]}{index}{self._brackets[1]}"

    def add(
        self,
        path: str,
        shape: tuple[int, ...],
        dtype: np.dtype,
        values: Values,
        unit: str = "",
    ) -> None:
        """Add an array, which `values` reads in parts; list it in `others` if it is no signal."""
        *across, along = sorted(
            (axis for axis, size in enumerate(shape) if size != 1),
            key=lambda axis: (shape[axis], -axis),
        ) or [-1]  # the longer side of a matrix is time
        wide = shape[across[0]] if across else 1
        if (
            dtype.kind not in _SIGNALS
            or along < 0
            or len(across) > 1
            or 0 in shape
            or wide > WIDEST
        ):
            size = " × ".join(map(str, shape)) or "one value"
            self.others[path] = f"{_WORDS.get(dtype.kind, dtype.name)}, {size}"
            return
        for position in range(wide):
            where: list[int | slice] = [0] * len(shape)
            where[along] = _ALL
            name = path
            if across:
                where[across[0]] = position
                number = position + self._first
                name += self.index(f":,{number}" if along < across[0] else f"{number},:")
            series = Series(name, dtype.name, shape[along], unit)
            self._found[name] = series, values, tuple(where)

    def contents(self) -> Contents:
        """Return all signals, of which the times that equal the first one are marked."""
        times = [path for path in self._found if re.split("[./]", path)[-1].lower() == "time"]
        for other in times[1:]:
            (_, values, where), (series, own, at) = self._found[times[0]], self._found[other]
            if np.array_equal(values(where), own(at)):
                self._found[other] = series._replace(is_twin=True), own, at
        return Contents([series for series, *_ in self._found.values()], self._read, self.others)

    def _read(self, paths: Collection[str], size: int) -> Iterator[Frame]:
        length = max((self._found[path][0].length for path in paths), default=0)
        for start in range(0, length, size):
            part = slice(start, start + size)
            columns = {}
            for path in paths:
                _, values, where = self._found[path]
                picked = tuple(part if at == _ALL else at for at in where)
                columns[path] = known_times(values(picked))
            yield "", columns


def known_times(values: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return an array with dates and durations, if any, in whole nanoseconds."""
    kind = values.dtype.kind
    return values.astype(f"{kind}8[ns]") if kind in "mM" else values


def read(path: Path) -> Contents:
    """Return the signals of a NumPy file: vectors, columns of matrices, fields of records."""
    loaded = np.load(path, allow_pickle=False)
    is_one = not isinstance(loaded, np.lib.npyio.NpzFile)
    found = Arrays("[]")
    for name in [path.stem] if is_one else loaded.files:
        try:
            array = loaded if is_one else loaded[name]
        except ValueError:  # pickled objects, which could run any code
            found.others[name] = "objects, which are not read"
            continue
        for field in array.dtype.names or ("",):
            values = array[field] if field else array
            path_of = f"{name}.{field}" if field else name
            found.add(path_of, values.shape, values.dtype, values.__getitem__)
    return found.contents()
