"""Files that cannot be used: one sentence with the place and the remedy."""

import gzip
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from joint_log import assert_words, csv_text, joint_columns, refused

from flexid.errors import RecordingError
from flexid.recording import channel, read_log, series
from flexid.streaming.incoming import Replay

GOOD = csv_text(joint_columns(60)).encode()
LINES = GOOD.decode().splitlines()
Edit = Callable[[list[str]], list[str]]


def cell(line: int, column: int, text: str) -> Edit:
    """Replace one cell; lines count from 1."""

    def edit(lines: list[str]) -> list[str]:
        cells = lines[line - 1].split(",")
        cells[column] = text
        return [*lines[: line - 1], ",".join(cells), *lines[line:]]

    return edit


def header(old: str, new: str) -> Edit:
    """Change the header."""
    return lambda lines: [lines[0].replace(old, new), *lines[1:]]


def line(number: int, *texts: str) -> Edit:
    """Put other lines in the place of one, which counts from 1."""
    return lambda lines: [*lines[: number - 1], *texts, *lines[number:]]


def added(number: int, *texts: str) -> Edit:
    """Insert lines before one, which counts from 1."""
    return lambda lines: [*lines[: number - 1], *texts, *lines[number - 1 :]]


def without(name: str) -> Edit:
    """Remove a column."""

    def edit(lines: list[str]) -> list[str]:
        index = lines[0].split(",").index(name)
        rows = [line.split(",") for line in lines]
        return [",".join(row[:index] + row[index + 1 :]) for row in rows]

    return edit


def clocked(step: int) -> Edit:
    """Let the time count by so much from row to row."""
    return lambda lines: [
        lines[0],
        *(f"{step * k},{line.split(',', 1)[1]}" for k, line in enumerate(lines[1:])),
    ]


TEXTS: list[tuple[Edit, str]] = [
    (lambda lines: lines[:1], "line 1: no samples follow .* export the log again"),
    (lambda lines: lines[:2], "there is 1 sample where 20"),
    (lambda lines: lines[:3], "2 samples where 20 are the fewest that are read, and 75 .* longer"),
    (lambda lines: lines[1:], "line 1: the file begins with numbers: write a header"),
    (without("motor_position"), "line 1: .*no motor_position.*; found 'time', 'link_.*column map"),
    (header("motor_position", "motor_positon"), "no motor_position .did you mean 'motor_positon'"),
    (
        header("link_position", "link_position [furlong!]"),
        r"line 1, column 'link_position \[furlong!\]'.*not known for this column: write \[rad\]",
    ),
    (
        header("link_position", "link_position [count]"),
        r"\[count\] depends on the encoder: write unit = 'turn' and scale = '1/4096'",
    ),
    (header("link_position", "link_position [rad/s]"), r"\[rad/s\] is not known for this column"),
    (header("motor_velocity", "time"), "line 1: the column 'time' stands there twice"),
    (header("motor_velocity", "time [ms]"), r"'time' and 'time \[ms\]' are both time: rename or"),
    (header("motor_velocity", "Time"), "line 1: the columns 'time' and 'Time' are both time"),
    (cell(7, 0, "nan"), "line 7, column 'time': nan is not a finite number"),
    (
        lambda lines: cell(9, 1, "x")(cell(8, 1, "inf")(cell(7, 1, "inf")(lines))),
        "line 7.*remove the row, and 2 more of the column",
    ),
    (cell(7, 2, "-inf"), "line 7.* -inf is not a finite number: remove the row"),
    (cell(7, 2, "1e999"), "line 7.* 1e999 is not a finite number"),
    (cell(7, 2, "1e99"), r"column 'motor_position': .*reaches 1e\+99 rad: correct"),
    (cell(9, 0, ""), "line 9, column 'time': the cell is empty: fill it in"),
    (cell(9, 1, "oops"), "line 9.*'oops' is not a number"),
    (cell(2, 0, "s"), "line 2, column 'time': 's' is not a number"),
    (cell(9, 0, "2024-05-01 12:00:00.5"), "line 9.* nor a time stamp such as"),
    (
        lambda lines: [*lines[:31], f"{lines[30].rpartition(',')[0]},7", *lines[31:]],
        r"line 32, column 'time': time repeats \(0.145 s\): remove the repeated row",
    ),
    (
        lambda lines: [*lines[:30], *lines[10:]],
        r"line 31, column 'time': .*backwards \(from 0.14 s to 0.045 s\): sort the rows",
    ),
    (line(10, "0.04,1.0"), "line 10: the row has 2 cells where the header has 6: complete or remo"),
    (line(3, "0.04,1.0"), "line 3: the row has 2 cells where the header has 6"),
    (lambda lines: [lines[0], *(["1,2,3"] * 30)], "line 2: the row has 3 cells where"),
    (line(10, LINES[9] + ",1"), "line 10: the row has 7 cells where the header has 6"),
    (line(2, LINES[1].replace("0.0", '"0,0"', 1)), "line 2, column 'time': '0,0' has a comma.*poi"),
    (
        lambda lines: [lines[0], *(one.replace(".", ",") for one in lines[1:])],
        "line 2: the row has 12 cells where the header has 6.*another separator",
    ),
    (cell(9, 1, '"1.0'), "line 9: a quotation mark opens on this line and does not close on it"),
    (
        lambda lines: cell(12, 1, '1.0"')(cell(9, 1, '"1.0')(lines)),
        "line 9: a quotation mark opens on this line and does not close on it: remove it",
    ),
    (cell(61, 5, '"1.0'), "line 61: a quotation mark opens"),
    (cell(9, 1, '"1"0'), "line 9: text follows a quotation mark"),
    (header("time", '"time'), "line 1: a quotation mark opens in the header"),
    (lambda lines: ["# " + one for one in lines], "nothing but comments"),
    (
        lambda lines: added(2, "ms,rad,rad,rad/s,rad/s,Nm")(header("time", "time [s]")(lines)),
        r"line 2, column 'time \[s\]': the unit below the name is \[ms\]: .*agree",
    ),
    (
        lambda lines: [
            one + "," + ",".join(f"{k}" if n else f"c{k}" for k in range(10_000))
            for n, one in enumerate(lines[:4])
        ],
        "10006 columns of 3 rows, more than are read at once",
    ),
    (lambda lines: [",".join(lines) * 300], "line 1: the line has more than 1000000"),
    (clocked(1), r"column 'time': the sample time would be 1 s, .*numbers the samples.*\[ms\]"),
    (clocked(5), r"the sample time would be 5 s, .*as in \[ms\]"),
    (clocked(5000), r"the sample time would be 5000 s, .*as in \[us\]"),
    (clocked(5_000_000), r"the sample time would be 5e\+06 s, .*as in \[ns\]"),
]


@pytest.mark.parametrize(("edit", "words"), TEXTS, ids=[words[:40] for _, words in TEXTS])
def test_bad_text(edit: Edit, words: str, tmp_path: Path) -> None:
    """Assert that the message names the place and the remedy."""
    path = tmp_path / "log.csv"
    path.write_text("\n".join(edit(list(LINES))) + "\n", encoding="utf-8")
    assert_words(words, refused(read_log, path))


@pytest.mark.parametrize(
    ("content", "name", "words"),
    [
        (b"", "log.csv", "the file is empty: export the log again"),
        (b"\n \n", "log.csv", "empty"),
        (bytes(range(256)) * 20, "log.csv", "binary file, not text: export the log as CSV"),
        *((bytes([code]) * 99, "log.csv", "binary file, not text") for code in (1, 8, 14, 31)),
        (gzip.compress(GOOD), "log.csv.gz", "packed by gzip: unpack it"),
        (b"PK\x03\x04" + b"\0" * 99, "log.xlsx", "workbooks are: .*save the sheet as CSV"),
        (b"PAR1....PAR1", "log.csv", "this is a Parquet file: rename it .*.parquet"),
        (GOOD, "log.parquet", "not a Parquet file that can be read: .*name it .csv"),
        (b"PAR1" + b"\1" * 50 + b"PAR1", "log.parquet", "not a Parquet file that can be read"),
        (b"nonsense", "log.parquet", "not a Parquet file that can be read"),
        (b"\xff\xfe" + b"\x00\xdc" * 9, "log.csv", "damaged UTF-16: save the file as UTF-8"),
        (GOOD.replace(b"\n0.005,", b"\n\xb5,"), "log.csv", "line 3.*'µ' is not a number"),
        (b'time = "t"', "columns.toml", "this is a TOML file.*--columns"),
        (b"{}", "estimate.json", "this is a JSON file.*export the log"),
        (b"{}\n{}", "log.jsonl", "these are lines of JSON.*export the log"),
    ],
)
def test_bad_bytes(content: bytes, name: str, words: str, tmp_path: Path) -> None:
    """Assert that a file that is not what its name says is refused."""
    path = tmp_path / name
    path.write_bytes(content)
    assert_words(words, refused(read_log, path))


def test_lines_are_counted_as_an_editor_does(tmp_path: Path) -> None:
    """Assert that blank lines before the header count."""
    path = tmp_path / "log.csv"
    path.write_text("\n\n" + "\n".join(cell(21, 0, "oops")(LINES)))
    assert "line 23, column 'time'" in refused(read_log, path)


def test_paths_that_lead_to_no_file(tmp_path: Path) -> None:
    """Assert that links, pipes, folders and impossible names are known for what they are."""
    assert_words("there is no such file: check the spelling", refused(read_log, tmp_path / "a.csv"))
    assert "this is a folder: give the path of a log in it" in refused(read_log, tmp_path)
    (tmp_path / "a.csv").symlink_to("b.csv")
    assert "a link to a file that is not there" in refused(read_log, tmp_path / "a.csv")
    (tmp_path / "b.csv").symlink_to("a.csv")
    assert "a link that leads back to itself" in refused(read_log, tmp_path / "a.csv")
    os.mkfifo(tmp_path / "pipe.csv")
    assert "not a regular file" in refused(read_log, tmp_path / "pipe.csv")
    assert r"two\nlines.csv: there is no such file" in refused(read_log, Path("two\nlines.csv"))
    words = "^http://example.com/a.csv: this is an address: download it"
    assert_words(words, refused(read_log, Path("http://example.com/a.csv")))
    refused(read_log, Path("a\0b.csv"))
    words = r"^x{140}\.\.\.x{136}\.csv: "
    assert_words(words, refused(read_log, Path("x" * 297 + ".csv")))
    assert_words("^x{296}.csv: ", refused(read_log, Path("x" * 296 + ".csv")))


def test_huge_file(tmp_path: Path) -> None:
    """Assert that a file over the limit is refused before it is read."""
    path = tmp_path / "log.csv"
    with path.open("wb") as file:
        file.truncate(1_000_000_000)  # a hole: no block is written
    assert_words("larger than 500 MB, the most that is read.*cut the log", refused(read_log, path))


def test_too_many_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Assert that a small Parquet file with too many rows is refused before it is unpacked."""
    monkeypatch.setattr(series, "MOST_ROWS", 1000)
    path = tmp_path / "log.parquet"
    pl.DataFrame(joint_columns(5000)).write_parquet(path)
    assert_words("5000 rows, more than the 1000 .*--stream", refused(read_log, path))


@pytest.mark.parametrize(("most", "columns", "rows"), [(10**9, 10_006, 1), (299, 6, 50)])
def test_parquet_of_more_than_memory_holds(
    most: int, columns: int, rows: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Assert that a file of very many cells is refused before they are unpacked."""
    monkeypatch.setattr(channel, "MOST_CELLS", most)
    path = tmp_path / "log.parquet"
    more = {f"c{k}": np.zeros(50) for k in range(columns - 6)}
    pl.DataFrame({**joint_columns(50), **more}).write_parquet(path)
    words = f"there are {columns} columns of {rows} rows, more than are read at once"
    assert words in refused(read_log, path)
    assert words in refused(lambda: Replay(path, None))
    text = path.with_suffix(".csv")
    pl.read_parquet(path).write_csv(text)
    assert f"there are {columns} columns of 50 rows, more than are read" in refused(read_log, text)


def test_columns_that_are_not_read(tmp_path: Path) -> None:
    """Assert that what is in other columns, however much, takes no memory."""
    big = pl.Series("big", np.zeros((60, 50_000)))
    pl.DataFrame({**joint_columns(60), "big": big}).write_parquet(tmp_path / "log.parquet")
    assert len(read_log(tmp_path / "log.parquet").recordings[0]) == 60


@pytest.mark.parametrize("count", [-1, 63, 127])
def test_a_page_that_promises_too_much(count: int, tmp_path: Path) -> None:
    """Assert that a page that promises 2^61 values, which ends Polars, ends nothing here."""
    path = tmp_path / "log.parquet"
    draw = np.random.default_rng(1)
    names = ("time", "motor_position", "motor_torque")
    pl.DataFrame({name: draw.normal(size=100) for name in names}).write_parquet(path)
    value = (count << 1) ^ (count >> 63)  # as Thrift writes it, in the place of 100
    other = bytes([value & 127 | 128, value >> 7 & 127])
    path.write_bytes(path.read_bytes().replace(bytes([0xC8, 0x01]), other, 1))
    assert "the file cannot be read on from there" in refused(read_log, path)
    assert "the file cannot be read on from there" in refused(lambda: Replay(path, None))


def test_parquet_types(tmp_path: Path) -> None:
    """Assert that text, dates and missing values in Parquet are named with column and row."""
    frame = pl.DataFrame(joint_columns(60))
    missing = pl.when(pl.col("time") > 0.0).then("time").alias("time")
    for changed, words in (
        (pl.col("link_position").cast(pl.String), "column 'link_position': it holds values of typ"),
        ((pl.col("motor_torque") * 1e6).cast(pl.Datetime("us")), "'motor_torque': it holds dates"),
        (missing, "row 1, column 'time': the cell is empty"),
    ):
        frame.with_columns(changed).write_parquet(tmp_path / "log.parquet")
        assert words in refused(read_log, tmp_path / "log.parquet")
    frame.head(0).write_parquet(tmp_path / "log.parquet")
    assert "no samples" in refused(read_log, tmp_path / "log.parquet")


def read_or_refuse(folder: Path, name: str, content: bytes) -> None:
    """Read a file; anything but a log or a `RecordingError` fails."""
    path = folder / name
    path.write_bytes(content)
    with suppress(RecordingError):
        recordings = read_log(path).recordings
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
    for row, column, value in cells:
        columns[[*columns][column]][row] = value
    read_or_refuse(tmp_path, "log.csv", csv_text(columns).encode())
