"""The elements of a MATLAB file, checked before SciPy believes them.

SciPy takes the type of an element for a place in a table, and the dimensions of a struct for the
size of an array. Where a damaged file has others, it reads beyond the table, and the process ends,
or it fills all memory; nothing catches either. Versions 5 to 7.2 are meant; version 4 has no types.
"""

from __future__ import annotations

import io
import struct
import zlib
from math import prod
from typing import TYPE_CHECKING

from flexid.recording.limits import LARGEST_UNPACKED
from flexid.recording.outside import DEEPEST

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_HEADER = 128  # bytes before the first element
_INT8, _UINT32, _MATRIX, _COMPRESSED, _UTF8 = 1, 6, 14, 15, 16  # types of elements
_INTEGERS = frozenset({5, _UINT32})  # some write the unsigned type
_NUMBERS = frozenset({1, 2, 3, 4, 5, 6, 7, 9, 12, 13})
_LETTERS = _NUMBERS | {16, 17, 18}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17  # of matrices
_MOST_DIMENSIONS = 32
_IS_COMPLEX = 1 << 11  # in the flags of a matrix


class DamagedError(ValueError):
    """An element is not what it can be."""


class TooLargeError(ValueError):
    """Unpacked, the elements are larger than what is read."""


def check_elements(path: Path) -> None:
    """Look at every element of a file.

    Raises
    ------
    DamagedError
        If one is of a type, or larger, than it can be where it stands.
    TooLargeError
        If they are larger than memory when they are unpacked.
    """
    with path.open("rb") as file:
        order = {b"IM": "<", b"MI": ">"}.get(file.read(_HEADER)[126:128])
    if order is None:
        return
    total = 0
    for kind, data in _elements(path, order):
        if kind == _COMPRESSED:
            total += _size(data, LARGEST_UNPACKED - total)
            walk = _Walk(zlib.decompressobj().decompress(data), order)
            kind, end = walk.tag()
            _require(kind == _MATRIX and end <= len(walk.data))
        else:
            walk, end = _Walk(data, order), len(data)
        _require(kind == _MATRIX)
        walk.matrix(end, 0)


def _elements(path: Path, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and content of the outermost elements."""
    with path.open("rb") as file:
        end = file.seek(0, io.SEEK_END)
        file.seek(_HEADER)
        while tag := file.read(8):
            _require(len(tag) == 8)
            kind, size = struct.unpack(f"{order}II", tag)
            _require(size <= end - file.tell())  # as many bytes as are asked for are reserved
            yield kind, file.read(size)


def _size(packed: bytes, most: int) -> int:
    """How many bytes something has when it is unpacked, a part at a time."""
    unpacker, size = zlib.decompressobj(), 0
    while packed and not unpacker.eof:
        size += len(unpacker.decompress(packed, 1_000_000))
        packed = unpacker.unconsumed_tail
        if size > most:
            raise TooLargeError
    return size


def _require(holds: bool) -> None:
    if not holds:
        raise DamagedError


class _Walk:
    """A way through the elements of a matrix."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data = data
        self._tag = struct.Struct(f"{order}II")
        self._number = struct.Struct(f"{order}i")
        self._place = 0

    def tag(self) -> tuple[int, int]:
        """Type of the element that begins here, and where it ends."""
        _require(self._place + 8 <= len(self.data))
        kind, size = self._tag.unpack_from(self.data, self._place)
        if kind >> 16:  # a small element, within the tag
            kind, size = kind & 0xFFFF, kind >> 16
            _require(size <= 4)
            self._place += 4
        else:
            self._place += 8
        return kind, self._place + size

    def matrix(self, end: int, depth: int) -> None:
        """Check what a matrix holds up to a place."""
        _require(depth <= DEEPEST and end <= len(self.data))
        if self._place == end:  # an empty one
            return
        flags = self._part(end, {_UINT32})
        _require(len(flags) == 8)
        (word,) = self._number.unpack_from(flags)
        kind = word & 255
        if kind == _OPAQUE:
            for _ in range(3):
                self._part(end, {_INT8})
            self._inner(end, 1, depth)
            return
        sizes = self._part(end, _INTEGERS)
        _require(8 <= len(sizes) <= 4 * _MOST_DIMENSIONS and len(sizes) % 4 == 0)
        dimensions = [number for (number,) in self._number.iter_unpack(sizes)]
        _require(min(dimensions) >= 0)
        self._part(end, {_INT8, _UTF8})  # its name
        count = prod(dimensions)
        if kind in (_CELL, _FUNCTION):
            self._inner(end, count if kind == _CELL else 1, depth)
        elif kind in (_STRUCT, _OBJECT):
            self._fields(end, count, depth, is_object=kind == _OBJECT)
        else:
            self._values(end, kind, is_complex=bool(word & _IS_COMPLEX))

    def _fields(self, end: int, count: int, depth: int, *, is_object: bool) -> None:
        """Check the fields of structs."""
        if is_object:
            self._part(end, {_INT8})
        length = self._part(end, _INTEGERS)
        _require(len(length) == 4)
        (longest,) = self._number.unpack(length)
        names = self._part(end, {_INT8})
        _require(longest > 0 and len(names) % longest == 0)
        _require(bool(names) or count <= 1)
        self._inner(end, count * (len(names) // longest), depth)

    def _values(self, end: int, kind: int, *, is_complex: bool) -> None:
        """Check numbers, letters, or the three parts of a sparse matrix."""
        parts = 1 + is_complex + 2 * (kind == _SPARSE)
        for _ in range(parts):
            self._part(end, _LETTERS if kind == _CHAR else _NUMBERS)

    def _inner(self, end: int, count: int, depth: int) -> None:
        """Check so many matrices."""
        _require(8 * count <= end - self._place)  # each has a tag
        for _ in range(count):
            kind, inner_end = self.tag()
            _require(kind == _MATRIX and inner_end <= end)
            self.matrix(inner_end, depth + 1)
            self._place = inner_end

    def _part(self, end: int, kinds: frozenset[int] | set[int]) -> bytes:
        """The content of an element of one of some types, which is padded to eight bytes."""
        begin = self._place
        kind, stop = self.tag()
        _require(kind in kinds and stop <= end)
        content = self.data[self._place : stop]
        self._place = stop + (begin - stop) % 8
        return content
