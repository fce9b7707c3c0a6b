"""Reading of text files as columns of text, with the line of a bad row in errors."""

from __future__ import annotations

import csv
import hashlib
import os
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.errors import RecordingError
from flexid.files import read_bytes, shown
from flexid.readers.formats import looks_like
from flexid.recording.layout import BLANK, COMMENTS, Layout, layout_of, split
from flexid.recording.recording import LARGEST_FILE, check_cells
from flexid.recording.table import Table, line_of

if TYPE_CHECKING:
    import polars

MINUS = "\N{MINUS SIGN}".encode()  # written before numbers in some locales
UTF_16 = (b"\xff\xfe", b"\xfe\xff")
COMMENT_MARKS = tuple(mark.encode() for mark in COMMENTS)

_STANDARD_INPUT = Path("-")

_CLOSED_QUOTE = "text follows a quotation mark within a cell: remove one"
_OPEN_QUOTE = "a quotation mark opens on this line and does not close on it: remove it"
_NO_LOGS = {  # other files, with a message
    ".toml": "this is a TOML file, not a log: a column map is given with --columns",
    ".json": "this is a JSON file, not a log: export the log as CSV or Parquet",
    ".jsonl": "these are lines of JSON, not a log: export the log as CSV or Parquet",
}


def read_table(path: Path) -> Table:
    """Return a text file as columns of text; ``-`` is standard input."""
    file = "standard input" if path == _STANDARD_INPUT else shown(path)
    refuse = partial(RecordingError, file, "")
    if os.path.isdir(path) and any(one.suffix in (".zst", ".zstd") for one in path.iterdir()):
        raise refuse("this bag is compressed as a whole: unpack its files with zstd -d --rm")
    remedy = "identify it as Parquet with --stream, or cut the log into shorter files"
    if path == _STANDARD_INPUT:
        if sys.stdin is None:  # closed by the shell
            raise refuse("it is closed: give the path of a log")
        raw = sys.stdin.buffer.read(LARGEST_FILE + 1)
        if len(raw) > LARGEST_FILE:
            raise refuse(f"it is longer than {LARGEST_FILE / 1e6:g} MB: {remedy}")
    else:
        raw = read_bytes(path, LARGEST_FILE, "a log", refuse, shorten=remedy)
    if not raw.strip():
        raise refuse("the file is empty: export the log again")
    if path.suffix.lower() in _NO_LOGS:
        raise refuse(_NO_LOGS[path.suffix.lower()])
    found = looks_like(raw)
    if found is not None:
        raise refuse(f"this is {found.what}: rename it so that it ends in {found.suffixes[0]}")
    return replace(read_text(file, raw), sha256=hashlib.sha256(raw).hexdigest())


def read_text(file: str, raw: bytes) -> Table:
    """Return a text in any of the usual encodings as columns of text."""
    text = as_utf_8(file, raw)
    layout = layout_of(file, text)
    body = _rows(text[layout.start :])
    if not body:
        reason = "no samples follow the header: export the log again"
        raise RecordingError(file, f"line {layout.header_line}", reason)
    check_cells(file, body.count(b"\n") + 1, len(layout.names))
    header = text.split(b"\n", layout.header_line)[layout.header_line - 1].strip()
    frame = None if b'"' in body or b"\n" + header in body else _frame(layout, body)
    if frame is None or frame[layout.names[-1]].null_count():  # a row may be too short
        is_cut = not text.endswith(b"\n")
        layout, body = _samples(file, layout, body, header.decode(errors="replace"), is_cut=is_cut)
        frame = _frame(layout, body)
    if frame is None:
        reason = f"the rows below {layout.names[0]!r} do not form a table: export the log as CSV"
        raise RecordingError(file, "", reason)
    table = layout.table(file, layout.without_twins(file, frame))
    return replace(table, warnings=tuple(_warnings(file, layout)))


def _warnings(file: str, layout: Layout) -> Iterator[str]:
    """Warnings of the lines of a text that were not read."""
    for (first, last), why in layout.skipped.items():
        lines = f"line {first} was" if first == last else f"lines {first} to {last} were"
        yield f"{file}: {lines} not read, since {why}: check this"
    if layout.left_out:
        first, more = min(layout.left_out), len(layout.left_out) - 1
        lines = f"line {first} and {more} more were" if more else f"line {first} was"
        why = " or ".join(dict.fromkeys(layout.left_out.values()))
        yield f"{file}: {lines} left out, as {why}"


def _samples(
    file: str, layout: Layout, body: bytes, header: str, *, is_cut: bool
) -> tuple[Layout, bytes]:
    """Remove lines without a sample, and half a last row; raise for rows of another width."""
    is_blank, width = layout.separator == BLANK, len(layout.names)
    kept: list[str] = []
    left_out: dict[int, str] = {}

    def lines() -> Iterator[str]:
        text = body.decode("utf-8", errors="replace")
        for number, line in enumerate(text.split("\n"), layout.first_line):
            bare = line.strip()
            if not bare or bare == header:
                left_out[number] = "the column names once more" if bare else "blank"
            elif bare.startswith(COMMENTS) and (
                is_blank or len(split(line, layout.separator)) != width
            ):
                left_out[number] = "a comment"
            else:
                kept.append(line)
                yield " ".join(line.split()) if is_blank else line

    done, fault = 0, ""
    try:
        for row in csv.reader(lines(), delimiter=layout.separator, strict=True):
            if len(kept) > done + 1:
                fault = _OPEN_QUOTE
            elif len(row) != width:
                names = f"write as many names in line {layout.header_line}"
                fault = (
                    f"the row has {len(row)} cells where the header has {width}: "
                    f"{'complete or remove it' if done else names}; numbers with decimal commas "
                    f"need another separator"
                )
            if fault:
                break
            done += 1
    except csv.Error as error:
        # Otherwise the end of the file, or of the longest cell, is within a quotation.
        is_open = "expected after" not in str(error)
        fault = _OPEN_QUOTE if is_open else _CLOSED_QUOTE
    if fault:
        number = line_of(layout.first_line, done, left_out)
        is_half = is_cut and number == layout.first_line + body.count(b"\n")
        if not done or not is_half or len(split(kept[done], layout.separator)) >= width:
            raise RecordingError(file, f"line {number}", fault)
        left_out[number] = "a last row that is not complete"
        kept.pop()
    return replace(layout, left_out=left_out), "\n".join(kept).encode()


def _frame(layout: Layout, body: bytes) -> polars.DataFrame | None:
    """Cells of rows as text; None if they do not form a table."""
    import polars as pl

    if layout.separator == BLANK:  # single blanks between cells, and none at the ends of lines
        body = re.sub(rb"(?m)^ +| +$", b"", re.sub(rb"[ \t\r]+", b" ", body))
    try:
        return pl.read_csv(
            body,
            separator=layout.separator, has_header=False, infer_schema=False,
            schema=dict.fromkeys(layout.names, pl.String),
        )  # fmt: skip
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException):
        return None


def _rows(text: bytes) -> bytes:
    """Rows without trailing blank lines, comments, and rows of empty cells."""
    end = len(text)
    while end > 0:
        start = text.rfind(b"\n", 0, end) + 1
        line = text[start:end].strip(b" \t\r,;|")
        if line and not line.startswith(COMMENT_MARKS):
            break
        end = start - 1
    return text[: max(end, 0)].rstrip(b"\r")


_CONTROLS = bytes((*range(9), *range(14, 32)))


def as_utf_8(file: str, raw: bytes) -> bytes:
    """Return text as UTF-8 with line feeds, ASCII minus signs and no BOM; raise if it is binary."""
    refuse, encoding = partial(RecordingError, file, ""), _utf_16(raw)
    if encoding:
        try:
            raw = raw.decode(encoding).encode("utf-8")
        except UnicodeError:
            raise refuse("the text is damaged UTF-16: save the file as UTF-8") from None
    sample = raw[:65536]
    sample = sample.rstrip(b"\0") or sample  # a file that was not closed may have trailing zeros
    controls = len(sample) - len(sample.translate(None, _CONTROLS))
    if b"\0" in sample or controls > 0.01 * len(sample):
        raise refuse(
            "this is a binary or packed file, not text: unpack it, or export the log as CSV or "
            "Parquet"
        )
    text = raw.replace(b"\xef\xbb\xbf", b"")  # everywhere, since joined files have several
    if not text.isascii():
        try:
            text.decode("utf-8")
        except UnicodeDecodeError:
            text = _of_code_page(text).encode("utf-8")
        text = text.replace(MINUS, b"-")
    return text if b"\n" in text else text.replace(b"\r", b"\n")


_CODE_PAGES = {"gb2312": rb"[\xa1-\xfe]{4}", "cp932": rb"(?:[\x81-\x9f][\x40-\x7e\x80-\xfc]){2}"}
"""Codecs of Chinese and Japanese texts, with bytes that texts in Latin-1 lack."""


def _of_code_page(text: bytes) -> str:
    """Return a text that is not UTF-8: of a Chinese or Japanese code page, or else Latin-1."""
    for codec, tell in _CODE_PAGES.items():
        with suppress(UnicodeDecodeError):
            if re.search(tell, text):
                return text.decode(codec)
    return text.decode("latin-1")


def _utf_16(raw: bytes) -> str:
    """Codec of a UTF-16 text, with or without byte-order mark; empty for other texts."""
    if raw.startswith(UTF_16):
        return "utf-16"
    sample = raw[:4096]
    first, second = (sample[place::2].count(0) / max(1, len(sample) // 2) for place in (0, 1))
    if first + second < 0.9 or min(first, second) > 0.0:
        return ""
    return "utf-16-be" if first else "utf-16-le"
