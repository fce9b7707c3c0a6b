"""What a Parquet file says of itself, before it is believed."""

from __future__ import annotations

import io
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from joint_log import joint_columns

from flexid.errors import RecordingError
from flexid.recording import read_log, table
from flexid.recording.parquet_pages import DamagedError, shape_of
from flexid.recording.stream import LogStream

FRAME = pl.DataFrame(joint_columns(100)).with_columns(
    texts=pl.lit("a"), nothing=pl.lit(None), lists=pl.lit([1, 2, 3]), structs=pl.struct("time")
)


def parquet(frame: pl.DataFrame = FRAME, **options: Any) -> bytes:
    """A frame as Polars writes it."""
    buffer = io.BytesIO()
    frame.write_parquet(buffer, **options)
    return buffer.getvalue()


def arrow(**options: Any) -> bytes:
    """A frame as PyArrow writes it."""
    buffer = io.BytesIO()
    frame = FRAME.drop("nothing")
    pyarrow.parquet.write_table(frame.to_arrow(), buffer, **options)
    return buffer.getvalue()


@pytest.mark.parametrize(
    "options",
    [{}, {"compression": "uncompressed"}, {"row_group_size": 7}, {"data_page_size": 64}],
)
def test_polars_files(options: dict[str, Any]):
    """Assert that rows, columns and values are those of the frame."""
    shape = shape_of(io.BytesIO(parquet(**options)))
    assert shape[:3] == (100, 10, 1200)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"data_page_version": "2.0", "data_page_size": 64},
        {"use_dictionary": False, "compression": "gzip"},
        {"write_page_checksum": True, "write_page_index": True},
    ],
)
def test_pyarrow_files(options: dict[str, Any]):
    """Assert that what another library writes is read."""
    assert shape_of(io.BytesIO(arrow(**options)))[:3] == (100, 9, 1100)


def page_says(count: int) -> bytes:
    """A file of one column whose page says that it has so many values, for 100."""
    raw = bytearray(parquet(pl.DataFrame({"time": np.random.default_rng(1).normal(size=100)})))
    number = bytes([0xC8, 0x01])  # 100, as Thrift writes it
    at = raw.index(number)
    value = (count << 1) ^ (count >> 63)
    raw[at : at + 2] = bytes([value & 127 | 128, value >> 7 & 127])
    return bytes(raw)


def test_a_page_that_promises_too_much(tmp_path: Path):
    """Assert that a page whose header contradicts the footer is refused in both ways of reading."""
    with pytest.raises(DamagedError):
        shape_of(io.BytesIO(page_says(-1)))
    path = tmp_path / "log.parquet"
    path.write_bytes(page_says(-1))
    for read in (read_log, lambda one: LogStream(one, None, 50)):
        with pytest.raises(RecordingError, match="no readable Parquet file"):
            read(path)


Fields = dict[int, Any]


def thrift(value: Any) -> tuple[int, bytes]:
    """A value in Thrift's compact protocol, with its type."""
    if isinstance(value, bytes):
        return 8, varint(len(value)) + value
    if isinstance(value, int):
        return 6, varint((value << 1) ^ (value >> 63))
    if isinstance(value, dict):
        parts = [bytes([kind, *varint(key << 1)]) + raw for key, kind, raw in typed(value)]
        return 12, b"".join(parts) + b"\0"
    parts = [thrift(one) for one in value]
    return 9, bytes([0xF0 | parts[0][0], *varint(len(parts))]) + b"".join(raw for _, raw in parts)


def typed(fields: Fields) -> list[tuple[int, int, bytes]]:
    """Fields with their types."""
    return [(key, *thrift(value)) for key, value in fields.items()]


def varint(number: int) -> bytes:
    """A number of any length that is not negative."""
    head, rest = number & 127, number >> 7
    return bytes([head | 128]) + varint(rest) if rest else bytes([head])


def by_hand(
    page: Fields | None = None,
    column: Fields | None = None,
    group: Fields | None = None,
    footer: Fields | None = None,
) -> bytes:
    """A file of one page of 100 numbers, with other values in one of its structs."""
    header = thrift({1: 0, 2: 800, 3: 800, 5: {1: 100}} | (page or {}))[1]
    pages = header + bytes(800)
    columns = {3: [b"time"], 5: 100, 7: len(pages), 9: 4} | (column or {})
    groups = {1: [{3: columns}], 3: 100} | (group or {})
    schema = [{4: b"schema", 5: 1}, {4: b"time"}]
    last = thrift({2: schema, 3: 100, 4: [groups]} | (footer or {}))[1]
    return b"PAR1" + pages + last + len(last).to_bytes(4, "little") + b"PAR1"


def test_a_file_made_by_hand():
    """Assert that the file of which the next test changes numbers is whole."""
    assert shape_of(io.BytesIO(by_hand())) == (100, 1, 100, 800)


@pytest.mark.parametrize(
    "changed",
    [
        {"page": {2: -1}},
        {"page": {2: 2_000_000_000}},
        {"page": {3: 801}},
        {"page": {3: -5}},
        {"page": {5: {1: 99}}},
        {"page": {5: {1: 101}}},
        {"page": {5: {1: -1}}},
        {"page": {5: 100}},
        {"page": {1: 2, 7: {1: 1000}}},
        {"page": {1: 3, 8: {1: 100, 2: 101, 3: 100, 5: 0, 6: 0}}},
        {"page": {1: 3, 8: {1: 100, 2: 0, 3: 100, 5: 700, 6: 200}}},
        {"page": {5: {1: 200}}, "column": {5: 200}},
        {"column": {5: 99}},
        {"column": {5: 2**61}},
        {"column": {7: 10**9}},
        {"column": {9: 2**40}},
        {"column": {9: 0}},
        {"column": {9: b"4"}},
        {"group": {3: 101}},
        {"footer": {2: [{4: b"schema"}]}},
        {"footer": {3: 99}},
        {"footer": {4: b"groups"}},
    ],
    ids=str,
)
def test_numbers_that_contradict(changed: dict[str, Fields]):
    """Assert that whatever number of the file is wrong, it is found to be damaged."""
    with pytest.raises(DamagedError):
        shape_of(io.BytesIO(by_hand(**changed)))


def test_a_page_that_reaches_into_the_footer():
    """Assert that the footer is no part of a page, whatever the page and the column say."""
    header = len(thrift({1: 0, 2: 800, 3: 805, 5: {1: 100}})[1])
    with pytest.raises(DamagedError):
        shape_of(io.BytesIO(by_hand(page={3: 805}, column={7: header + 805})))


def test_a_dictionary_that_promises_too_much():
    """Assert that a dictionary has no more values than bytes, and that others are left alone."""
    for count, fits in ((8, True), (9, False)):
        page = thrift({1: 2, 2: 8, 3: 8, 7: {1: count}})[1] + bytes(8)
        data = thrift({1: 0, 2: 800, 3: 800, 5: {1: 100}})[1] + bytes(800)
        column = {7: len(page) + len(data), 9: 4 + len(page), 11: 4}
        raw = by_hand(column=column)
        footer = raw[4 + len(data) :]
        whole = io.BytesIO(b"PAR1" + page + data + footer)
        if fits:
            assert shape_of(whole) == (100, 1, 100, 808)
        else:
            with pytest.raises(DamagedError):
                shape_of(whole)


def test_nested_deep():
    """Assert that structs and lists in structs and lists end at a depth."""
    inner: Any = 1
    for _ in range(60):
        inner = [inner]
    with pytest.raises(DamagedError):
        shape_of(io.BytesIO(by_hand(footer={9: inner})))


@pytest.mark.parametrize("kind", [7, 8, 9, 12])
def test_a_list_that_promises_more_than_there_is(kind: int):
    """Assert that a list of 2^62 of anything ends where the file does."""
    footer = bytes([0x19, 0xF0 | kind]) + varint(2**62)
    raw = b"PAR1" + footer + len(footer).to_bytes(4, "little") + b"PAR1"
    with pytest.raises(DamagedError):
        shape_of(io.BytesIO(raw))


def test_what_it_saves_from(tmp_path: Path):
    """Assert that the same file ends a process that hands it to Polars unchecked."""
    path = tmp_path / "log.parquet"
    path.write_bytes(page_says(-1))
    code = f"import polars; polars.read_parquet({str(path)!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert done.returncode != 0


def test_lists_that_are_a_bomb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that values in lists are counted, too."""
    monkeypatch.setattr(table, "MOST_CELLS", 100_000)
    path = tmp_path / "log.parquet"
    pl.DataFrame({"time": [[0.0] * 200_000]}).write_parquet(path)
    with pytest.raises(RecordingError, match="of 200000 values, more than are read at once"):
        read_log(path)


WHOLE = parquet(row_group_size=50)


@settings(deadline=None, max_examples=150, derandomize=True)
@given(st.integers(0, 2**32), st.integers(1, 4))
def test_any_damage(seed: int, count: int):
    """Assert that of a damaged file nothing is raised but that it is damaged."""
    draw = np.random.default_rng(seed)
    raw = bytearray(WHOLE)
    for _ in range(count):
        at = int(draw.integers(len(raw)))
        raw[at : at + int(draw.integers(3))] = draw.bytes(int(draw.integers(4)))
    try:
        shape = shape_of(io.BytesIO(bytes(raw)))
    except DamagedError:
        return
    assert shape.rows >= 0


@settings(deadline=None, max_examples=150, derandomize=True)
@given(st.binary(max_size=300))
def test_any_bytes(footer: bytes):
    """Assert that any footer is read or found damaged."""
    raw = b"PAR1" + footer + len(footer).to_bytes(4, "little") + b"PAR1"
    with suppress(DamagedError):
        shape_of(io.BytesIO(raw))
