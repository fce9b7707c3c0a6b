"""Odd but plausible texts, as logs and as streams: the right numbers, or a sentence that helps."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from joint_log import csv_text, joint_columns

from flexid.errors import RecordingError
from flexid.recording import read_log
from flexid.streaming.incoming import TextSamples
from flexid.streaming.sources import GrowingFile
from flexid.streaming.text_stream import LineReader

CHANNELS = ("time", "link_position", "motor_position", "motor_torque")
COLUMNS = {name: joint_columns(500)[name] for name in CHANNELS}
TEXT = csv_text(COLUMNS)

Change = Callable[[str], str]


def rows(change: Change) -> Change:
    """Change each row of numbers."""

    def changed(text: str) -> str:
        header, *lines = text.splitlines()
        return "\n".join([header, *map(change, lines)]) + "\n"

    return changed


def cells(change: Change, separator: str = ",") -> Change:
    """Change each cell of each row, and what stands between them."""
    return rows(lambda line: separator.join(map(change, line.split(","))))


def german(text: str) -> str:
    """Decimal commas, between semicolons."""
    return text.replace(",", ";").replace(".", ",")


def fortran(cell: str) -> str:
    """A number as Fortran writes double precision."""
    return f"{float(cell):.17E}".replace("E", "D")


def grouped(mark: str, decimal: str = ".") -> Change:
    """Torques in mN m with marks between thousands, others with six decimals."""

    def changed(line: str) -> str:
        *others, torque = line.split(",")
        text = f"{1e3 * float(torque):,.1f}".replace(".", "!").replace(",", mark)
        return ";".join([*(o.replace(".", decimal) for o in others), text.replace("!", decimal)])

    return lambda text: rows(changed)(text).replace(",", ";", 3)


def scaled(line: str) -> str:
    """A row whose time is in microseconds."""
    time, _, others = line.partition(",")
    return f"{1e6 * float(time):.0f},{others}"


def whole(line: str) -> str:
    """A row of whole numbers, with commas between thousands."""
    return ";".join(f"{round(1e4 * float(cell)):,}" for cell in line.split(","))


READ: dict[str, Change] = {
    "quoted": cells(lambda cell: f'"{cell}"'),
    "quoted, with decimal commas": cells(lambda cell: '"' + cell.replace(".", ",") + '"'),
    "german": german,
    "rows end with a separator": rows(lambda line: line + ","),
    "all lines end with a separator": lambda text: text.replace("\n", ",\n"),
    "tabs at the ends of rows": lambda text: rows(lambda line: line + ",")(text).replace(",", "\t"),
    "tabs at the ends of lines": lambda text: text.replace("\n", ",\n").replace(",", "\t"),
    "tabs at the ends, and none below": lambda text: (
        text.replace("\n", ",\r\n").replace(",", "\t") + "  \r\n\r\n"
    ),
    "an empty first column": lambda text: ("n," + rows(lambda line: "," + line)(text)).replace(
        ",", "\t"
    ),
    "an empty last column": lambda text: rows(lambda line: line + ",")(
        text.replace("\n", ",spare\n", 1)
    ).replace(",", "\t"),
    "blanks around tabs": lambda text: text.replace(",", " \t ").replace("\n", " \n "),
    "an empty column": lambda text: rows(lambda line: line + ",")(
        text.replace("\n", ",spare\n", 1)
    ),
    "a boolean column": lambda text: rows(lambda line: line + ",true")(
        text.replace("\n", ",enabled\n", 1)
    ),
    "exponents of Fortran": cells(fortran),
    "a Fortran table": lambda text: "# " + cells(fortran, "   ")(text).replace(",", " "),
    "a minus sign": lambda text: text.replace("-", "\N{MINUS SIGN}"),
    "plus signs": cells(lambda cell: f"+{cell}".replace("+-", "-")),
    "a byte-order mark": lambda text: "\N{ZERO WIDTH NO-BREAK SPACE}" + text,
    "mixed ends of lines": lambda text: text.replace("1\n", "1\r\n"),
    "Latin-1": lambda text: rows(scaled)(text.replace("time", "time [\N{MICRO SIGN}s]")),
}


def written(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    """A text as a file."""
    path = folder / "log.csv"
    path.write_bytes(text.encode(encoding))
    return path


def streamed(path: Path) -> np.ndarray:
    """Samples of the same as of a stream."""
    found = []
    with closing(GrowingFile(path, stop_at_end=True)) as source:
        samples = TextSamples(source, LineReader(str(path)), None)
        while (part := samples.read(last=False)) is not None:
            if len(part):
                found.append(part)
    return np.concatenate(found)


@pytest.mark.parametrize("name", READ)
def test_read(tmp_path: Path, name: str) -> None:
    """Assert that log and stream hold the numbers that the text means."""
    encoding = "latin-1" if name == "Latin-1" else "utf-8"
    path = written(tmp_path, READ[name](TEXT), encoding)
    (recording,) = read_log(path).recordings
    assert recording.sample_time == pytest.approx(0.005)
    for channel, values in zip(CHANNELS[1:], (*recording_values(recording),), strict=True):
        np.testing.assert_allclose(values, COLUMNS[channel], rtol=1e-12)
    right = np.column_stack([*COLUMNS.values()])
    np.testing.assert_allclose(streamed(path), right, rtol=1e-12)


def recording_values(recording) -> tuple[np.ndarray, ...]:
    """Both positions and the input."""
    return recording.link_position, recording.motor_position, recording.input


REFUSED: dict[str, tuple[Change, str]] = {
    "the header once more": (
        lambda text: "\n".join([*text.splitlines()[:300], text]),
        "line 301, column 'time': the header stands here once more",
    ),
    "apostrophes between thousands": (grouped("'"), '"[^"]*\'[^"]*" has marks between its thou'),
    "blanks between thousands": (grouped(" "), r"'-?\d+ \d+\.\d' has marks between its thousands"),
    "commas between thousands": (grouped(","), r"'-?\d+,\d+\.\d' has marks between its thousands"),
    "points between thousands": (grouped(".", ","), r"'-?\d+\.\d+,\d' has marks between its thous"),
    "whole thousands": (
        lambda text: rows(whole)(text).replace(",", ";", 3),
        "cannot be known whether",
    ),
    "hexadecimal": (cells(lambda cell: hex(int(1e4 * float(cell)))), "'0x0' is not a number"),
    "words for numbers": (
        rows(lambda line: ",".join([*line.split(",")[:-1], str(line[-1] > "5")])),
        "'(True|False)' is not a number: correct it, or remove the row, and",
    ),
    "numbers in parentheses": (
        cells(lambda cell: f"({cell[1:]})" if cell.startswith("-") else cell),
        r"'\(0\.\d+\)' is not a number",
    ),
    "a name too many": (
        lambda text: "Log\n" + text.replace("\n", ",comment\n", 1),
        "line 3: the row has 4 cells where the header has 5: let the names in line 2 be as many",
    ),
    "JSON": (
        lambda text: "".join(f'{{"time": {line}}}\n' for line in text.splitlines()),
        "line 1: this is JSON: write a header",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(tmp_path: Path, name: str) -> None:
    """Assert that a log says where and why, and a stream of nothing else the same."""
    change, words = REFUSED[name]
    path = written(tmp_path, change(TEXT))
    with pytest.raises(RecordingError, match=words):
        read_log(path)
    if name not in ("the header once more", "numbers in parentheses"):  # few lines are no rows
        with pytest.raises(RecordingError, match=words):
            streamed(path)


def test_one_sample(tmp_path: Path) -> None:
    """Assert that it is counted in the singular."""
    with pytest.raises(RecordingError, match="there is 1 sample where 20"):
        read_log(written(tmp_path, "\n".join(TEXT.splitlines()[:2])))


def test_a_file_that_was_not_closed(tmp_path: Path) -> None:
    """Assert that null bytes at its end are named, and cost a stream no sample."""
    path = written(tmp_path, TEXT + "\0" * 4096)
    with pytest.raises(RecordingError, match="line 502: null bytes stand there"):
        read_log(path)
    assert len(streamed(path)) == 500


@pytest.mark.parametrize("cell", ["1.#IND", "inf", "-1.#QNAN0", "#N/A", "", "1,5", "1_000"])
def test_one_bad_cell(tmp_path: Path, cell: str) -> None:
    """Assert that a log refuses it with its line, and a stream loses that sample alone."""
    lines = [line.replace(",", ";") for line in TEXT.splitlines()]
    lines[300] = ";".join([*lines[300].split(";")[:-1], cell])
    path = written(tmp_path, "\n".join(lines) + "\n")
    with pytest.raises(RecordingError, match=r"line 301, column 'motor_torque': "):
        read_log(path)
    samples = streamed(path)
    assert np.flatnonzero(~np.isfinite(samples[:, 3])).tolist() == [299]
    assert np.isfinite(samples[:, :3]).all()


def test_a_stream_that_begins_without_numbers_is_waited_for(tmp_path: Path) -> None:
    """Assert that empty cells and numbers that are not finite are no reason to refuse it."""
    lines = TEXT.splitlines()
    for k in range(1, 250):
        lines[k] = ",".join([*lines[k].split(",")[:-1], "" if k % 2 else "nan"])
    samples = streamed(written(tmp_path, "\n".join(lines) + "\n"))
    assert np.isnan(samples[:249, 3]).all()
    assert np.isfinite(samples[249:]).all()


def test_a_minus_sign_behind_the_first_lines() -> None:
    """Assert that it is one there, too."""
    reader = LineReader("stream", fewest=4)
    assert reader.cells(b"time,motor_position\n0,1\n1,-2\n2,3\n") is not None
    cells = reader.cells("3,\N{MINUS SIGN}4\n".encode())
    assert cells is not None
    np.testing.assert_array_equal(cells, [[3.0, -4.0]])


@pytest.mark.parametrize("parts", [1, 3, 200])
def test_a_decimal_mark_is_that_of_the_first_lines(parts: int) -> None:
    """Assert that thousands are no decimals, whatever comes with which, and however it is cut."""
    lines = ["time [ms];motor_position;motor_torque", *(f"{k};{k % 7};{k % 5}" for k in range(250))]
    lines += ["250;1,234;1", "251;0,5;1", "252;1,234;1", "253;1.5;1"]
    raw = ("\n".join(lines) + "\n").encode()
    reader = LineReader("stream")
    edges = np.linspace(0, len(raw), parts + 1).astype(int)
    found = [reader.cells(raw[a:b], ended=b == len(raw)) for a, b in pairwise(edges)]
    cells = np.concatenate([part for part in found if part is not None])
    np.testing.assert_array_equal(cells[250:, 1], [np.nan, 0.5, 1.234, np.nan])
    assert re.fullmatch(b",", reader.rows._mark if reader.rows else b"")
