"""Files that cannot be used: one sentence with the place and the remedy."""

from __future__ import annotations

import gzip
import io
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from joint_log import csv_text, joint_columns

from flexid.errors import RecordingError
from flexid.recording import limits, read_log, series
from flexid.streaming.incoming import Replay

GOOD = csv_text(joint_columns(60)).encode()
LINES = GOOD.decode().splitlines()
Edit = Callable[[list[str]], list[str]]


def refusal(path: Path, columns: Path | None = None) -> str:
    """Return the message with which a file is refused."""
    with pytest.raises(RecordingError) as caught:
        read_log(path, columns)
    message = str(caught.value)
    assert message.startswith(caught.value.file)
    assert "\n" not in message
    return message


def cell(line: int, column: int, text: str) -> Edit:
    """Return an edit that replaces one cell; lines count from 1."""

    def edit(lines: list[str]) -> list[str]:
        cells = lines[line - 1].split(",")
        cells[column] = text
        return [*lines[: line - 1], ",".join(cells), *lines[line:]]

    return edit


def header(old: str, new: str) -> Edit:
    """Return an edit of the header."""
    return lambda lines: [lines[0].replace(old, new), *lines[1:]]


def without(name: str) -> Edit:
    """Return an edit that removes a column."""

    def edit(lines: list[str]) -> list[str]:
        index = lines[0].split(",").index(name)
        rows = [line.split(",") for line in lines]
        return [",".join(row[:index] + row[index + 1 :]) for row in rows]

    return edit


TEXT_CASES: dict[str, tuple[Edit, list[str]]] = {
    "header only": (lambda lines: lines[:1], ["line 1", "no samples", "export the log again"]),
    "two samples": (
        lambda lines: lines[:3],
        ["2 samples", "20 are the fewest that are read, and 75", "record for longer"],
    ),
    "no header": (lambda lines: lines[1:], ["line 1", "begins with numbers", "write a header"]),
    "missing column": (
        without("motor_position"),
        ["line 1", "no motor_position", "found 'time', 'link_position'", "column map"],
    ),
    "misspelt": (
        header("motor_position", "motor_positon"),
        ["no motor_position (did you mean 'motor_positon'?)"],
    ),
    "unknown unit": (
        header("link_position", "link_position [furlong!]"),
        ["line 1, column 'link_position [furlong!]'", "not known", "[rad], [deg]"],
    ),
    "encoder counts": (
        header("link_position", "link_position [count]"),
        ["[count] does not measure", "write [rad], [deg]"],
    ),
    "rate as position": (
        header("link_position", "link_position [rad/s]"),
        ["[rad/s] does not measure", "write [rad], [deg]"],
    ),
    "column twice": (header("motor_velocity", "time"), ["line 1", "'time' stands there twice"]),
    "channel twice": (
        header("motor_velocity", "time [ms]"),
        ["'time' and 'time [ms]' are both time", "rename or remove one"],
    ),
    "nan": (cell(7, 2, "nan"), ["line 7, column 'motor_position'", "nan is not a finite number"]),
    "a burst": (
        lambda lines: cell(9, 1, "")(cell(8, 1, "nan")(cell(7, 1, "nan")(lines))),
        ["line 7", "remove the row, and 2 more of the column"],
    ),
    "infinite": (cell(7, 2, "-inf"), ["line 7", "-inf is not a finite number", "remove the row"]),
    "too large": (cell(7, 2, "1e999"), ["line 7", "1e999 is not a finite number"]),
    "absurd": (cell(7, 2, "1e99"), ["column 'motor_position'", "reaches 1e+99 rad", "correct"]),
    "empty cell": (cell(9, 1, ""), ["line 9, column 'link_position'", "empty", "fill it in"]),
    "text cell": (cell(9, 1, "oops"), ["line 9", "'oops' is not a number", "correct it"]),
    "unit row": (cell(2, 0, "s"), ["line 2, column 'time'", "'s' is not a number"]),
    "date": (cell(9, 0, "2024-05-01 12:00:00.5"), ["line 9", "a date", "or stamps such as"]),
    "time repeats": (
        lambda lines: [*lines[:31], lines[30], *lines[31:]],
        ["line 32, column 'time'", "time repeats (0.145 s)", "remove the repeated row"],
    ),
    "time backwards": (
        lambda lines: [*lines[:30], *lines[10:]],
        ["line 31, column 'time'", "runs backwards (from 0.14 s to 0.045 s)", "sort the rows"],
    ),
    "short row": (
        lambda lines: [*lines[:9], "0.04,1.0", *lines[10:]],
        ["line 10", "2 cells where the header has 6", "complete or remove"],
    ),
    "short row at the beginning": (
        lambda lines: [*lines[:2], "0.04,1.0", *lines[3:]],
        ["line 3", "2 cells where the header has 6"],
    ),
    "short rows": (lambda lines: [lines[0], *(["1,2,3"] * 30)], ["line 2", "3 cells where"]),
    "long row": (
        lambda lines: [*lines[:9], lines[9] + ",1", *lines[10:]],
        ["line 10", "7 cells where the header has 6"],
    ),
    "blank line": (lambda lines: [*lines[:9], "", *lines[9:]], ["line 10", "blank", "remove it"]),
    "a decimal comma among points": (
        lambda lines: [*lines[:1], lines[1].replace("0.0", '"0,0"', 1), *lines[2:]],
        ["line 2, column 'time'", "'0,0' has a comma", "decimal points"],
    ),
    "decimal commas between commas": (
        lambda lines: [lines[0], *(line.replace(".", ",") for line in lines[1:])],
        ["line 2", "12 cells where the header has 6", "another separator"],
    ),
    "open quote": (
        cell(9, 1, '"1.0'),
        ["line 9", "a quotation mark opens on this line and does not close on it", "remove it"],
    ),
    "quote over lines": (
        lambda lines: cell(12, 1, '1.0"')(cell(9, 1, '"1.0')(lines)),
        ["line 9", "a quotation mark opens on this line and does not close on it"],
    ),
    "open quote in the last row": (cell(61, 5, '"1.0'), ["line 61", "a quotation mark opens"]),
    "quote within a cell": (cell(9, 1, '"1"0'), ["line 9", "follows a quotation mark"]),
    "open quote in the header": (header("time", '"time'), ["line 1", "quotation mark opens"]),
    "comment between samples": (
        lambda lines: [*lines[:9], "# paused", *lines[9:]],
        ["line 10", "a comment between samples: remove it"],
    ),
    "text below the header": (
        lambda lines: [lines[0], "Sensors: A, B", *lines[1:]],
        ["line 2", "between the column names and the numbers", "mend or remove it"],
    ),
    "only comments": (lambda lines: ["# " + line for line in lines], ["nothing but comments"]),
    "other unit below the name": (
        lambda lines: [lines[0].replace("time", "time [s]"), "ms,rad,rad,rad/s,rad/s,Nm",
                       *lines[1:]],
        ["line 2, column 'time [s]'", "the unit below the name is [ms]", "agree"],
    ),
    "two of a name but for letters": (
        header("motor_velocity", "Time"),
        ["line 1", "'time' and 'Time' are both time", "rename or remove one"],
    ),
    "too many columns": (
        lambda lines: [line + "," + ",".join(f"{k}" if n else f"c{k}" for k in range(10_000))
                       for n, line in enumerate(lines[:4])],
        ["10006 columns of 3 rows, more than are read at once"],
    ),
    "one endless line": (lambda lines: [",".join(lines) * 300], ["line 1", "more than 1000000"]),
    "milliseconds": (
        lambda lines: [lines[0], *(f"{k},{line.split(',', 1)[1]}" for k, line in
                                   enumerate(lines[1:]))],
        ["column 'time'", "sample time would be 1 s", "[ms]"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", TEXT_CASES)
def test_bad_text(name: str, tmp_path: Path) -> None:
    """Assert that the message names the place and the remedy."""
    edit, words = TEXT_CASES[name]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(edit(list(LINES))) + "\n", encoding="utf-8")
    message = refusal(path)
    for word in words:
        assert word in message


BYTES_CASES = {
    "empty": (b"", "log.csv", ["empty", "export the log again"]),
    "blank": (b"\n \n", "log.csv", ["empty"]),
    "binary": (bytes(range(256)) * 20, "log.csv", ["binary file", "export the log as CSV"]),
    "gzip": (gzip.compress(GOOD), "log.csv.gz", ["packed by gzip", "unpack it"]),
    "workbook": (b"PK\x03\x04" + b"\0" * 99, "log.xlsx", ["workbooks", "save the sheet as CSV"]),
    "parquet named csv": (b"PAR1....PAR1", "log.csv", ["Parquet", "rename it", ".parquet"]),
    "csv named parquet": (
        GOOD,
        "log.parquet",
        ["no Parquet file that can be read", "name it .csv"],
    ),
    "torn parquet": (
        b"PAR1" + b"\1" * 50 + b"PAR1",
        "log.parquet",
        ["no Parquet file that can be read"],
    ),
    "torn utf-16": (b"\xff\xfe" + b"\x00\xdc" * 9, "log.csv", ["damaged UTF-16", "as UTF-8"]),
    "latin-1": (
        GOOD.replace(b"\n0.005,", b"\n\xb5,"),
        "log.csv",
        ["line 3", "'µ' is not a number"],
    ),
    "column map as log": (b'time = "t"', "columns.toml", ["TOML file", "--columns"]),
    "estimate as log": (b"{}", "estimate.json", ["JSON file", "export the log"]),
}


@pytest.mark.parametrize("name", BYTES_CASES)
def test_bad_bytes(name: str, tmp_path: Path) -> None:
    """Assert that a file that is not what its name says is refused."""
    content, file, words = BYTES_CASES[name]
    path = tmp_path / file
    path.write_bytes(content)
    message = refusal(path)
    for word in words:
        assert word in message


def test_missing_file(tmp_path: Path) -> None:
    """Assert that a missing file is named."""
    path = tmp_path / "nowhere.csv"
    assert refusal(path).startswith(f"{path}: there is no such file: check the spelling")


def test_folder(tmp_path: Path) -> None:
    """Assert that a folder is told from a file."""
    assert "this is a folder: give the path of a log in it" in refusal(tmp_path)


def test_links(tmp_path: Path) -> None:
    """Assert that links that lead nowhere, or in a circle, are known for what they are."""
    (tmp_path / "a.csv").symlink_to("b.csv")
    assert "a link to a file that is not there" in refusal(tmp_path / "a.csv")
    (tmp_path / "b.csv").symlink_to("a.csv")
    assert "a link that leads back to itself" in refusal(tmp_path / "a.csv")


def test_pipe(tmp_path: Path) -> None:
    """Assert that a pipe is refused rather than waited for."""
    os.mkfifo(tmp_path / "pipe.csv")
    assert "no ordinary file" in refusal(tmp_path / "pipe.csv")


def test_path_with_a_line_break(tmp_path: Path) -> None:
    """Assert that a message stays on one line whatever the file is called."""
    assert r"two\nlines.csv: there is no such file" in refusal(tmp_path / "two\nlines.csv")


def test_impossible_path() -> None:
    """Assert that a path that no file can have is refused."""
    refusal(Path("a\0b.csv"))
    refusal(Path("x" * 5000 + ".csv"))


def test_huge_file(tmp_path: Path) -> None:
    """Assert that a file over the limit is refused before it is read."""
    path = tmp_path / "log.csv"
    with path.open("wb") as file:
        file.truncate(1_000_000_000)  # a hole: no block is written
    message = refusal(path)
    assert "larger than 500 MB, the most that is read" in message
    assert "cut the log" in message


def test_too_many_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Assert that a small Parquet file with too many rows is refused before it is unpacked."""
    monkeypatch.setattr(series, "MOST_ROWS", 1000)
    path = tmp_path / "log.parquet"
    pl.DataFrame(joint_columns(5000)).write_parquet(path)
    message = refusal(path)
    assert "5000 rows, more than the 1000" in message
    assert "--stream" in message


@pytest.mark.parametrize(("most", "columns", "rows"), [(10**9, 10_006, 1), (299, 6, 50)])
def test_parquet_of_more_than_memory_holds(
    most: int, columns: int, rows: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Assert that a file of very many cells is refused before they are unpacked."""
    monkeypatch.setattr(limits, "MOST_CELLS", most)
    path = tmp_path / "log.parquet"
    more = {f"c{k}": np.zeros(50) for k in range(columns - 6)}
    pl.DataFrame({**joint_columns(50), **more}).write_parquet(path)
    words = f"there are {columns} columns of {rows} rows, more than are read at once"
    assert words in refusal(path)
    with pytest.raises(RecordingError, match=words):
        Replay(path, None, at_once=True)
    text = path.with_suffix(".csv")
    pl.read_parquet(path).write_csv(text)
    assert f"there are {columns} columns of 50 rows, more than are read" in refusal(text)


def test_columns_that_are_not_read(tmp_path: Path) -> None:
    """Assert that what is in other columns, however much, takes no memory."""
    big = pl.Series("big", np.zeros((60, 50_000)))
    pl.DataFrame({**joint_columns(60), "big": big}).write_parquet(tmp_path / "log.parquet")
    assert len(read_log(tmp_path / "log.parquet").recordings[0]) == 60


@pytest.mark.parametrize("count", [-1, 63, 127])
def test_a_page_that_promises_too_much(count: int, tmp_path: Path) -> None:
    """Assert that a page that promises 2^61 values, which ends Polars, ends nothing here."""
    path = tmp_path / "log.parquet"
    names = ("time", "motor_position", "motor_torque")
    draw = np.random.default_rng(1)
    pl.DataFrame({name: draw.normal(size=100) for name in names}).write_parquet(path)
    number = bytes([0xC8, 0x01])  # 100, as Thrift writes it
    value = (count << 1) ^ (count >> 63)
    other = bytes([value & 127 | 128, value >> 7 & 127])
    path.write_bytes(path.read_bytes().replace(number, other, 1))
    words = "the file cannot be read on from there"
    assert words in refusal(path)
    with pytest.raises(RecordingError, match=words):
        Replay(path, None, at_once=True)


def test_parquet_types(tmp_path: Path) -> None:
    """Assert that text, dates and missing values in Parquet are named with column and row."""
    frame = pl.DataFrame(joint_columns(60))
    path = tmp_path / "log.parquet"
    frame.with_columns(pl.col("link_position").cast(pl.String)).write_parquet(path)
    assert "column 'link_position': it holds values of type String" in refusal(path)
    frame.with_columns((pl.col("motor_torque") * 1e6).cast(pl.Datetime("us"))).write_parquet(path)
    assert "column 'motor_torque': it holds dates" in refusal(path)
    missing = pl.when(pl.col("time") > 0.0).then("motor_torque").alias("motor_torque")
    frame.with_columns(missing).write_parquet(path)
    assert "row 1, column 'motor_torque': the cell is empty" in refusal(path)
    frame.head(0).write_parquet(path)
    assert "no samples" in refusal(path)


def read_or_refuse(folder: Path, name: str, content: bytes) -> None:
    """Read a file; anything but a log or a `RecordingError` fails."""
    path = folder / name
    path.write_bytes(content)
    try:
        recordings = read_log(path).recordings
    except RecordingError:
        return
    assert all(np.isfinite(recording.motor_position).all() for recording in recordings)


FUZZ = settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


@FUZZ
@given(content=st.binary(max_size=400))
def test_any_bytes(tmp_path: Path, content: bytes) -> None:
    """Assert that random bytes raise nothing but a `RecordingError`."""
    read_or_refuse(tmp_path, "log.csv", content)


@FUZZ
@given(data=st.data())
def test_any_mutation(tmp_path: Path, data: st.DataObject) -> None:
    """Assert that a mutated CSV file raises nothing but a `RecordingError`."""
    content = bytearray(GOOD)
    for _ in range(data.draw(st.integers(1, 4))):
        start = data.draw(st.integers(0, len(content) - 1))
        length = data.draw(st.sampled_from([0, 1, 1, 2, 30, 2000]))
        patches = [b"", b",", b"\n", b'"', b";", b"-", b"e", b"e99", b"e-300", b"0", b"9" * 30]
        patch = data.draw(st.sampled_from(patches) | st.binary(max_size=6))
        content[start : start + length] = patch
    read_or_refuse(tmp_path, "log.csv", bytes(content))


@FUZZ
@given(
    cells=st.lists(
        st.tuples(
            st.integers(0, 59),
            st.integers(0, 5),
            st.floats(allow_nan=True, allow_infinity=True, width=64),
        ),
        min_size=1,
        max_size=5,
    )
)
@example(cells=[(0, 0, 1e308), (1, 0, 1e308)])
@example(cells=[(0, 1, 1e308), (1, 1, 1e308), (2, 1, -1e308), (3, 1, -1e308)])
@example(cells=[(0, 1, float("inf")), (1, 1, -float("inf"))])
def test_any_number(tmp_path: Path, cells: list[tuple[int, int, float]]) -> None:
    """Assert that any number in any cell raises nothing but a `RecordingError`."""
    columns = joint_columns(60)
    names = list(columns)
    for row, column, value in cells:
        columns[names[column]][row] = value
    read_or_refuse(tmp_path, "log.csv", csv_text(columns).encode())


@settings(FUZZ, max_examples=20)
@given(start=st.integers(4, 10_000), patch=st.binary(min_size=1, max_size=3))
def test_any_parquet_mutation(tmp_path: Path, start: int, patch: bytes) -> None:
    """Assert that a damaged Parquet file raises nothing but a `RecordingError`."""
    buffer = io.BytesIO()
    pl.DataFrame(joint_columns(60)).write_parquet(buffer)
    content = bytearray(buffer.getvalue())
    start = 4 + start % (len(content) - 8 - len(patch))
    content[start : start + len(patch)] = patch
    read_or_refuse(tmp_path, "log.parquet", bytes(content))
