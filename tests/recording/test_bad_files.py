"""Unusable files: one message with the place and the remedy."""

import gzip
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from joint_log import csv_text, joint_columns, refused, said, without, written

from flexid.recording import read_log, recording, series
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
    """Replace one line, counted from 1, by others."""
    return lambda lines: [*lines[: number - 1], *texts, *lines[number:]]


def clocked(step: int) -> Edit:
    """Replace the time by whole multiples of a step."""
    return lambda lines: [
        lines[0],
        *(f"{step * k},{line.split(',', 1)[1]}" for k, line in enumerate(lines[1:])),
    ]


def each(edit: Callable[[str], str]) -> Edit:
    """Change each row of numbers."""
    return lambda lines: [lines[0], *map(edit, lines[1:])]


FURLONGS = header("link_position", "link_position [furlong!]")
THRICE = "".join(f",{k}" for k in range(10_000))
MORE = "".join(f",c{k}" for k in range(10_000))
TEXTS: dict[str, Edit] = {
    "a header alone": lambda lines: lines[:1],
    "one sample": lambda lines: lines[:2],
    "two samples": lambda lines: lines[:3],
    "no header": lambda lines: lines[1:],
    "no motor": lambda _: csv_text(without(joint_columns(60), "motor_position")).splitlines(),
    "a misspelt motor": header("motor_position", "motor_positon"),
    "a unit that is none": FURLONGS,
    "counts": header("link_position", "link_position [count]"),
    "a unit of another kind": header("link_position", "link_position [rad/s]"),
    "a name twice": header("motor_velocity", "time"),
    "a name in two units": header("motor_velocity", "time [ms]"),
    "a name in other letters": header("motor_velocity", "Time"),
    "no number": cell(7, 0, "nan"),
    "three infinities": lambda t: cell(9, 1, "x")(cell(8, 1, "inf")(cell(7, 1, "inf")(t))),
    "minus infinity": cell(7, 2, "-inf"),
    "beyond floating point": cell(7, 2, "1e999"),
    "a huge number": cell(7, 2, "1e99"),
    "huge times": lambda t: cell(3, 0, "1e308")(cell(2, 0, "1e308")(t)),
    "huge positions": lambda t: cell(4, 1, "-1e308")(cell(3, 1, "1e308")(cell(2, 1, "1e308")(t))),
    "both infinities": lambda t: cell(3, 1, "-inf")(cell(2, 1, "inf")(t)),
    "an empty time": cell(9, 0, ""),
    "a word": cell(9, 1, "oops"),
    "a word in the first row": cell(2, 0, "s"),
    "a stamp among numbers": cell(9, 0, "2024-05-01 12:00:00.5"),
    "a time twice": line(32, f"{LINES[30].rpartition(',')[0]},7", LINES[31]),
    "a time that runs back": lambda lines: [*lines[:30], *lines[10:]],
    "a short row": line(10, "0.04,1.0"),
    "a short second row": line(3, "0.04,1.0"),
    "short rows": each(lambda _: "1,2,3"),
    "a long row": line(10, LINES[9] + ",1"),
    "a decimal comma": line(2, LINES[1].replace("0.0", '"0,0"', 1)),
    "decimal commas between commas": each(lambda row: row.replace(".", ",")),
    "an open quotation": cell(9, 1, '"1.0'),
    "one over lines": lambda lines: cell(12, 1, '1.0"')(cell(9, 1, '"1.0')(lines)),
    "one at the end": cell(61, 5, '"1.0'),
    "text behind a quotation": cell(9, 1, '"1"0'),
    "an open quotation in the header": header("time", '"time'),
    "comments alone": lambda lines: ["# " + one for one in lines],
    "two units": lambda t: line(2, "ms,rad,rad,rad/s,rad/s,Nm", t[1])(
        header("time", "time [s]")(t)
    ),
    "many columns": lambda lines: [lines[0] + MORE, *(one + THRICE for one in lines[1:4])],
    "a long line": lambda lines: [",".join(lines) * 300],
    "numbers of samples": clocked(1),
    "steps of 5": clocked(5),
    "steps of 5000": clocked(5000),
    "steps of 5000000": clocked(5_000_000),
}
BYTES: dict[str, tuple[str, bytes]] = {
    "nothing": ("log.csv", b""),
    "blank lines": ("log.csv", b"\n \n"),
    "every byte": ("log.csv", bytes(range(256)) * 20),
    **{f"byte {code}": ("log.csv", bytes([code]) * 99) for code in (1, 8, 14, 31)},
    "gzip": ("log.csv.gz", gzip.compress(GOOD)),
    "a workbook": ("log.xlsx", b"PK\x03\x04" + b"\0" * 99),
    "Parquet by another name": ("log.csv", b"PAR1....PAR1"),
    "text as Parquet": ("log.parquet", GOOD),
    "damaged Parquet": ("log.parquet", b"PAR1" + b"\1" * 50 + b"PAR1"),
    "nonsense": ("log.parquet", b"nonsense"),
    "damaged UTF-16": ("log.csv", b"\xff\xfe" + b"\x00\xdc" * 9),
    "a number that is none": ("log.csv", GOOD.replace(b"\n0.005,", b"\n\xb5,")),
    "TOML": ("columns.toml", b'time = "t"'),
    "JSON": ("estimate.json", b"{}"),
    "lines of JSON": ("log.jsonl", b"{}\n{}"),
    "lines before the header": ("log.csv", b"\n\n" + GOOD.replace(b"\n0.095,", b"\noops,")),
}


def test_bad_files(here: Path, golden: Any) -> None:
    """Assert that each is refused with the place and the remedy."""
    edited = {n: ("log.csv", ("\n".join(edit(LINES)) + "\n").encode()) for n, edit in TEXTS.items()}
    files = {**edited, **BYTES}
    golden({n: said(read_log, written(Path(), raw, name=p)) for n, (p, raw) in files.items()})


def test_paths_that_lead_to_no_file(here: Path, golden: Any) -> None:
    """Assert that broken links, pipes, folders and impossible names are refused as such."""
    for name, other in {"dead.csv": "none.csv", "a.csv": "b.csv", "b.csv": "a.csv"}.items():
        Path(name).symlink_to(other)
    os.mkfifo("pipe.csv")
    names = ("none.csv", ".", "dead.csv", "a.csv", "pipe.csv", "two\nlines.csv", "a\0b.csv")
    names += ("http://example.com/a.csv", "x" * 297 + ".csv", "y" * 296 + ".csv")
    golden({repr(name)[:20]: said(read_log, Path(name)) for name in names})


def test_huge_file(tmp_path: Path) -> None:
    """Assert that a file over the limit is refused before it is read."""
    path = tmp_path / "log.csv"
    with path.open("wb") as file:
        file.truncate(1_000_000_000)  # a sparse file: no block is written
    assert re.search("larger than 500 MB, the most that is.*cut the log", refused(read_log, path))


def test_tables_of_more_than_memory_holds(here: Path, golden: Any, monkeypatch: Any) -> None:
    """Assert that too many columns, cells or rows are refused before they are unpacked."""
    more = {f"c{k}": np.zeros(50) for k in range(10_000)}
    pl.DataFrame({**joint_columns(50), **more}).write_parquet("wide.parquet")
    pl.read_parquet("wide.parquet").write_csv("wide.csv")
    pl.DataFrame(joint_columns(50)).write_parquet("long.parquet")
    found = {name: said(read_log, Path(name)) for name in ("wide.parquet", "wide.csv")}
    for module, limit, most in ((recording, "MOST_CELLS", 299), (series, "MOST_ROWS", 49)):
        with monkeypatch.context() as patched:
            patched.setattr(module, limit, most)
            found[f"{limit} {most}"] = said(read_log, Path("long.parquet"))
        monkeypatch.setattr(module, limit, most + 1)
        assert len(read_log(Path("long.parquet")).recordings[0]) == 50
    golden(found)
    assert refused(lambda: Replay(Path("wide.parquet"), None)) == found["wide.parquet"]
