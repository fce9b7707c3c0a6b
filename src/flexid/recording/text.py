"""From the bytes of a text file to columns of text, every bad row with its line."""

from __future__ import annotations

import csv
import hashlib
import io
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.errors import RecordingError
from flexid.files import read_bytes, shown
from flexid.readers.formats import looks_like
from flexid.recording.channel import LARGEST_FILE, check_cells
from flexid.recording.layout import BLANK, COMMENTS, Layout, layout_of, split
from flexid.recording.table import Table, line_of

if TYPE_CHECKING:
    import polars

MINUS = "\N{MINUS SIGN}".encode()  # as some languages' formats write it before a number
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
_COMMENTS = tuple(mark.encode() for mark in COMMENTS)

_STANDARD_INPUT = Path("-")

_PACKED = {
    b"\x1f\x8b": "gzip",
    b"PK\x03\x04": "zip, as archives and workbooks are",
    b"BZh": "bzip2",
    b"\xfd7zXZ\x00": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"7z\xbc\xaf": "7z",
}
_OPEN_QUOTE = "a quotation mark opens on this line and does not close on it: remove it"
_OTHERS = {  # what else flexid reads, and where it belongs
    ".toml": "this is a TOML file, not a log: a column map is given with --columns",
    ".json": "this is a JSON file, not a log: export the log as CSV or Parquet",
    ".jsonl": "these are lines of JSON, not a log: export the log as CSV or Parquet",
}


def read_table(path: Path) -> Table:
    """A text file as columns of text; ``-`` is standard input."""
    file = "standard input" if path == _STANDARD_INPUT else shown(path)
    refuse = partial(RecordingError, file, "")
    if os.path.isdir(path) and any(one.suffix in (".zst", ".zstd") for one in path.iterdir()):
        raise refuse("this bag is compressed as a whole: unpack its files with zstd -d --rm")
    remedy = "identify it as Parquet with --stream, or cut the log into shorter files"
    if path == _STANDARD_INPUT:
        raw = sys.stdin.buffer.read(LARGEST_FILE + 1)
        if len(raw) > LARGEST_FILE:
            raise refuse(f"it is longer than {LARGEST_FILE / 1e6:g} MB: {remedy}")
    else:
        raw = read_bytes(path, LARGEST_FILE, "a log", refuse, shorten=remedy)
    if not raw.strip():
        raise refuse("the file is empty: export the log again")
    if path.suffix.lower() in _OTHERS:
        raise refuse(_OTHERS[path.suffix.lower()])
    found = looks_like(raw)
    if found is not None:
        raise refuse(f"this is {found.what}: rename it so that it ends in {found.suffixes[0]}")
    return replace(read_text(file, raw), sha256=hashlib.sha256(raw).hexdigest())


def read_text(file: str, raw: bytes) -> Table:
    """A text in UTF-8, in UTF-16, or in Latin-1 as columns of text."""
    text = as_utf_8(file, raw)
    layout = layout_of(file, text)
    body = _rows(text[layout.start :])
    if not body:
        reason = "no samples follow the header: export the log again"
        raise RecordingError(file, f"line {layout.header_line}", reason)
    layout, body = _without_cut_row(layout, text, body)
    header = text.split(b"\n", layout.header_line)[layout.header_line - 1].strip()
    if b"\n" + header in body:
        layout, body = _samples(layout, body, header)
    try:
        frame = _frame(file, layout, body)
    except RecordingError:
        layout, body = _samples(layout, body, header)
        if not layout.left_out:
            raise
        frame = _frame(file, layout, body)
    return replace(layout.table(file, frame), warnings=tuple(_warnings(file, layout)))


def _warnings(file: str, layout: Layout) -> Iterator[str]:
    """What was not read of a text."""
    for (first, last), why in layout.skipped.items():
        lines = f"line {first} was" if first == last else f"lines {first} to {last} were"
        yield f"{file}: {lines} not read, since {why}: check that they do"
    if layout.left_out:
        first, more = min(layout.left_out), len(layout.left_out) - 1
        lines = f"line {first} and {more} more were" if more else f"line {first} was"
        why = " or ".join(dict.fromkeys(layout.left_out.values()))
        yield f"{file}: {lines} left out, as {why}"


def _without_cut_row(layout: Layout, text: bytes, body: bytes) -> tuple[Layout, bytes]:
    """Rows without the last one where the file ends in it, as where its logger was killed."""
    start = body.rfind(b"\n") + 1
    cells = split(body[start:].decode("utf-8", errors="replace"), layout.separator)
    if not start or text.endswith(b"\n") or len(cells) >= len(layout.names):
        return layout, body
    number = layout.first_line + body.count(b"\n")
    why = "a last row that is not complete"
    return replace(layout, left_out={number: why}), body[: start - 1]


def _samples(layout: Layout, body: bytes, header: bytes) -> tuple[Layout, bytes]:
    """Rows without the lines between them that are blank, a comment, or the header once more."""
    separator = layout.separator.encode()
    kept: list[bytes] = []
    left_out: dict[int, str] = {}
    for number, line in enumerate(body.split(b"\n"), layout.first_line):
        bare = line.strip()
        is_row = line.count(separator) == len(layout.names) - 1 and separator != b" "
        if not bare:
            left_out[number] = "blank"
        elif bare == header:
            left_out[number] = "the column names once more"
        elif bare.startswith(_COMMENTS) and not is_row:
            left_out[number] = "a comment"
        else:
            kept.append(line)
    return replace(layout, left_out={**left_out, **layout.left_out}), b"\n".join(kept)


def _frame(file: str, layout: Layout, body: bytes) -> polars.DataFrame:
    """Cells of rows; raise where these are no table."""
    import polars as pl

    if layout.separator == BLANK:
        body = re.sub(rb"(?m)^ +| +$", b"", re.sub(rb"[ \t\r]+", b" ", body))
    names = layout.names
    check_cells(file, body.count(b"\n") + 1, len(names))
    try:
        frame = pl.read_csv(
            body, separator=layout.separator, has_header=False, infer_schema=False,
            schema=dict.fromkeys(names, pl.String),
        )  # fmt: skip
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        fault = _ragged_row(file, layout, body) or RecordingError(
            file, "", f"the rows below {names[0]!r} do not form a table: export the log as CSV"
        )
        raise fault from error
    if b'"' in body or frame[names[-1]].null_count():
        fault = _ragged_row(file, layout, body)
        if fault is not None:
            raise fault
    return layout.without_twins(file, frame)


def _rows(text: bytes) -> bytes:
    """Rows without what follows the last: blank lines, comments, and rows of empty cells."""
    end = len(text)
    while end > 0:
        start = text.rfind(b"\n", 0, end) + 1
        line = text[start:end].strip(b" \t\r,;|")
        if line and not line.startswith(_COMMENTS):
            break
        end = start - 1
    return text[: max(end, 0)].rstrip(b"\r")


_CONTROLS = bytes((*range(9), *range(14, 32)))


def check_text(file: str, raw: bytes) -> None:
    """Raise where bytes are those of no text, nor of one that is in UTF-16."""
    packed = next((how for begin, how in _PACKED.items() if raw.startswith(begin)), None)
    if packed is not None:
        reason = f"the file is packed by {packed}: unpack it, or save the sheet as CSV"
        raise RecordingError(file, "", reason)
    sample = raw[:65536]
    sample = sample.rstrip(b"\0") or sample  # a file that was not closed may end so
    controls = len(sample) - len(sample.translate(None, _CONTROLS))
    if b"\0" in sample or controls > 0.01 * len(sample):
        raise RecordingError(
            file, "", "this is a binary file, not text: export the log as CSV or Parquet"
        )


def as_utf_8(file: str, raw: bytes) -> bytes:
    """The text as UTF-8 without byte-order mark, with line feeds, and a hyphen for a minus."""
    encoding = _utf_16(raw)
    if encoding:
        try:
            raw = raw.decode(encoding).encode("utf-8")
        except UnicodeError:
            raise RecordingError(
                file, "", "the text is damaged UTF-16: save the file as UTF-8"
            ) from None
    check_text(file, raw)
    text = raw.replace(b"\xef\xbb\xbf", b"")  # also where two files were joined
    if not text.isascii():
        try:
            text.decode("utf-8")
        except UnicodeDecodeError:
            text = text.decode("latin-1").encode("utf-8")
        text = text.replace(MINUS, b"-")
    return text if b"\n" in text else text.replace(b"\r", b"\n")


def _utf_16(raw: bytes) -> str:
    """The kind of UTF-16 in which a text is, also without a byte-order mark; empty for others."""
    if raw.startswith(UTF_16):
        return "utf-16"
    sample = raw[:4096]
    first, second = (sample[place::2].count(0) / max(1, len(sample) // 2) for place in (0, 1))
    if first + second < 0.9 or min(first, second) > 0.0:
        return ""
    return "utf-16-be" if first else "utf-16-le"


def _ragged_row(file: str, layout: Layout, body: bytes) -> RecordingError | None:
    """The first row whose number of cells differs from the header's, if there is one."""
    lines = io.TextIOWrapper(io.BytesIO(body), encoding="utf-8", errors="replace", newline="")
    reader = csv.reader(lines, delimiter=layout.separator, strict=True)
    first, left_out = layout.first_line, layout.left_out
    index, before = 0, 0
    try:
        for row in reader:
            line = line_of(first, index, left_out)
            fault = _OPEN_QUOTE if reader.line_num > before + 1 else _fault(layout, line, row)
            if fault:
                return RecordingError(file, f"line {line}", fault)
            index, before = index + 1, reader.line_num
    except csv.Error as error:
        # The end of the file, or of the longest cell, is reached within a quotation.
        fault = _OPEN_QUOTE
        if "expected after" in str(error):
            fault = "text follows a quotation mark within a cell: remove one"
        return RecordingError(file, f"line {line_of(first, index, left_out)}", fault)
    return None


def _fault(layout: Layout, line: int, row: list[str]) -> str:
    """What is wrong with a row, if anything is."""
    if not row:
        return "the line is blank: remove it"
    if len(row) == len(layout.names):
        return ""
    remedy = "complete or remove it"
    if line == layout.first_line:
        remedy = f"let the names in line {layout.header_line} be as many"
    return (
        f"the row has {len(row)} cells where the header has {len(layout.names)}: {remedy}; numbers "
        f"with decimal commas need another separator"
    )
