"""Parquet's own account of itself, checked before Polars believes it.

Polars reserves memory for as many values as a page says that it has. Where a damaged page says
2**61, the allocation ends the process, and nothing catches that. So the footer and the header of
every page are read here first, which are in Thrift's compact protocol, and have to agree.
"""

from __future__ import annotations

import io
import struct
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

MAGIC = b"PAR1"
_LARGEST_FOOTER = 16_000_000  # bytes; one of a log has thousands
_LARGEST_HEADER = 100_000  # bytes of a page's header, which may hold the extremes of long texts
_LARGEST_PAGE = 1_000_000_000  # bytes, unpacked; pages have about one megabyte
_DEEPEST = 16
_DATA, _DICTIONARY, _DATA_2 = 0, 2, 3  # types of pages
_HEADER_OF = {_DATA: 5, _DICTIONARY: 7, _DATA_2: 8}


class Shape(NamedTuple):
    """What a Parquet file holds.

    Parameters
    ----------
    rows, columns : int
        Columns are those of nested types, each by itself.
    values : int
        In all columns; those of lists have more than the rows.
    unpacked : int
        Bytes of all pages.
    """

    rows: int
    columns: int
    values: int
    unpacked: int


class DamagedError(ValueError):
    """The file contradicts itself."""


def shape_of(file: BinaryIO) -> Shape:
    """Read and check the footer of a Parquet file and the headers of its pages.

    Raises
    ------
    DamagedError
        If they contradict each other, or the size of the file.
    """
    footer, end = _footer(file)
    groups = _structs(footer.get(4))
    rows, values, unpacked = 0, 0, 0
    for group in groups:
        count = _number(group, 3)
        rows += count
        for column in _structs(group.get(1)):
            content = _struct(column.get(3))
            values += _number(content, 5)
            unpacked += _checked_column(file, content, count, end)
    _require(rows == _number(footer, 3))
    leaves = [one for one in _structs(footer.get(2))[1:] if not one.get(5)]
    _require(all(len(_structs(group.get(1))) == len(leaves) for group in groups))
    return Shape(rows, len(leaves), values, unpacked)


def _footer(file: BinaryIO) -> tuple[dict[int, Any], int]:
    """The footer's fields, and where it begins."""
    size = file.seek(0, io.SEEK_END)
    _require(size >= 12)
    file.seek(size - 8)
    tail = file.read(8)
    (length,) = struct.unpack("<I", tail[:4])
    begin = size - 8 - length
    _require(tail[4:] == MAGIC and begin >= 4 and length <= _LARGEST_FOOTER)
    file.seek(begin)
    return _Thrift(file.read(length)).struct(), begin


def _checked_column(file: BinaryIO, column: dict[int, Any], rows: int, end: int) -> int:
    """Check the pages of a column of a group of rows; return their size when unpacked."""
    values, packed = _number(column, 5), _number(column, 7)
    begin = _number(column, 9)
    dictionary = column.get(11)
    if isinstance(dictionary, int) and 0 < dictionary < begin:
        begin = dictionary
    _require(begin + packed <= end)
    # A column within lists has as many values as it likes; a plain one has one for each row.
    _require(len(_list(column.get(3))) > 1 or values == rows)
    left, found, unpacked = packed, 0, 0
    for header, length in _pages(file, begin, packed):
        kind, size = _number(header, 1), _number(header, 3)
        plain = _number(header, 2)
        left -= length + size
        _require(left >= 0 and plain <= _LARGEST_PAGE)
        unpacked += plain
        if kind in _HEADER_OF:
            count = _checked_page(kind, _struct(header.get(_HEADER_OF[kind])), plain)
            found += count if kind != _DICTIONARY else 0
            _require(found <= values)
    _require(found == values and left == 0)
    return unpacked


def _checked_page(kind: int, inner: dict[int, Any], size: int) -> int:
    """How many values a page has."""
    count = _number(inner, 1)
    if kind == _DICTIONARY:
        _require(count <= size)
    if kind == _DATA_2:
        _require(_number(inner, 2) <= count and _number(inner, 3) <= count)
        _require(_number(inner, 5) + _number(inner, 6) <= size)
    return count


def _pages(file: BinaryIO, begin: int, packed: int) -> Iterator[tuple[dict[int, Any], int]]:
    """The headers of consecutive pages, and their lengths."""
    place = begin
    while place < begin + packed:
        file.seek(place)
        thrift = _Thrift(file.read(min(_LARGEST_HEADER, begin + packed - place)))
        header = thrift.struct()
        yield header, thrift.place
        place += thrift.place + _number(header, 3)


def _number(fields: dict[int, Any], key: int) -> int:
    """A number that is not negative."""
    value = fields.get(key)
    _require(isinstance(value, int) and value >= 0)
    return value  # pyright: ignore[reportReturnType]


def _list(value: Any) -> list[Any]:
    _require(isinstance(value, list))
    return value


def _struct(value: Any) -> dict[int, Any]:
    _require(isinstance(value, dict))
    return value


def _structs(value: Any) -> list[dict[int, Any]]:
    return [_struct(one) for one in _list(value)]


def _require(holds: bool) -> None:
    if not holds:
        raise DamagedError


class _Thrift:
    """Values in Thrift's compact protocol, by the numbers of their fields."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.place = 0

    def struct(self, depth: int = 0) -> dict[int, Any]:
        """The fields of a struct."""
        fields: dict[int, Any] = {}
        key = 0
        while head := self._byte():
            delta, kind = head >> 4, head & 15
            key = key + delta if delta else self._zigzag()
            fields[key] = kind == 1 if kind in (1, 2) else self._value(kind, depth)
        return fields

    def _value(self, kind: int, depth: int) -> Any:
        _require(depth <= _DEEPEST)
        if kind in (1, 2, 3):  # within a list a truth is a byte
            return self._byte()
        if kind in (4, 5, 6):
            return self._zigzag()
        if kind == 7:
            return self._bytes(8)
        if kind == 8:
            return self._bytes(self._varint())
        if kind in (9, 10):
            head = self._byte()
            count = head >> 4 if head >> 4 != 15 else self._varint()
            return [self._value(head & 15, depth + 1) for _ in range(count)]
        _require(kind == 12)  # Parquet has no maps
        return self.struct(depth + 1)

    def _byte(self) -> int:
        _require(self.place < len(self._data))
        self.place += 1
        return self._data[self.place - 1]

    def _bytes(self, count: int) -> bytes:
        self.place += count
        _require(self.place <= len(self._data))  # or a list of billions would be read from nothing
        return self._data[self.place - count : self.place]

    def _varint(self) -> int:
        value, shift = 0, 0
        while True:
            byte = self._byte()
            value |= (byte & 127) << shift
            if byte < 128:
                return value
            shift += 7
            _require(shift < 64)

    def _zigzag(self) -> int:
        value = self._varint()
        return (value >> 1) ^ -(value & 1)
