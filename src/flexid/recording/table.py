"""From a file's bytes to columns of numbers, every bad cell with its place."""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError

if TYPE_CHECKING:
    from pathlib import Path

    import polars

    from flexid.recording.recording import FloatArray

LARGEST_FILE = 500_000_000  # bytes; read at once, at about four times that in memory
LARGE_REMEDY = "identify it as Parquet with --stream, or cut the log into shorter files"
MOST_ROWS = 5_000_000  # an identification in memory takes 2 kB for each
PARQUET_MAGIC = b"PAR1"
PARQUET_SUFFIXES = (".parquet", ".pq")
SEPARATORS = ",;\t|"


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a file, not yet numbers.

    Parameters
    ----------
    file : str
        Name of the file.
    header : str
        Where the names of the columns stand, such as ``"line 1"``.
    first_row : int
        Number of the first row of values, as `row_word` counts.
    row_word : str
        ``"line"`` for a text file, ``"row"`` for Parquet.
    frame : polars.DataFrame
        Text columns of a CSV file, typed columns of a Parquet file.
    sha256 : str
        Digest of the file's bytes.
    """

    file: str
    header: str
    first_row: int
    row_word: str
    frame: polars.DataFrame
    sha256: str

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, as they stand in the file."""
        return tuple(self.frame.columns)

    def place(self, index: int, name: str) -> str:
        """Return where the value of column `name` in row `index` (from 0) stands in the file."""
        return f"{self.row_word} {self.first_row + index}, column {name!r}"

    def numbers(self, name: str) -> FloatArray:
        """Return a column as numbers.

        Parameters
        ----------
        name : str
            One of `names`.

        Returns
        -------
        FloatArray, shape (n,)

        Raises
        ------
        RecordingError
            If a cell is empty, is not a number, or is not finite.
        """
        import polars as pl

        column = self.frame[name]
        if column.dtype.is_temporal():
            raise self._not_numeric(name, "dates or times of day")
        if self.row_word == "row" and not column.dtype.is_numeric():
            raise self._not_numeric(name, f"values of type {column.dtype}")
        if column.dtype == pl.String:
            column = column.str.strip_chars()
        values = column.cast(pl.Float64, strict=False).to_numpy()
        with np.errstate(all="ignore"):  # of numbers too large to be added
            total = values.sum()
        # It is finite only if all numbers are, and faster than asking each.
        if not (np.isfinite(total) or np.isfinite(values).all()):
            index = int(np.argmin(np.isfinite(values)))
            raise RecordingError(
                self.file, self.place(index, name), _bad_cell(self.frame[name][index])
            )
        return np.require(values, np.float64, "W")

    def _not_numeric(self, name: str, found: str) -> RecordingError:
        remedy = "seconds since the start" if "time" in name.lower() else "floating-point numbers"
        return RecordingError(
            self.file, f"column {name!r}", f"it holds {found}: write it as {remedy}"
        )


def read_table(path: Path) -> Table:
    """Read a CSV or a Parquet file.

    Parameters
    ----------
    path : Path
        A file whose name ends in ``.parquet`` or ``.pq`` is read as Parquet, any other as text.

    Returns
    -------
    Table

    Raises
    ------
    RecordingError
        If the file is missing, too large, empty, or not what its name says.
    """
    raw = read_bytes(path, LARGEST_FILE, LARGE_REMEDY)
    is_parquet = path.suffix.lower() in PARQUET_SUFFIXES
    digest = hashlib.sha256(raw).hexdigest()
    frame_reader = _read_parquet if is_parquet else _read_csv
    return frame_reader(path.name, raw, digest)


def scan_parquet(path: Path) -> tuple[polars.LazyFrame, int]:
    """Open a Parquet file of any size.

    Returns
    -------
    frame : polars.LazyFrame
        Its columns, not yet read.
    rows : int
        How many there are.

    Raises
    ------
    RecordingError
        If there is no such file, or it is no Parquet file, or an incomplete or an empty one.
    """
    import polars as pl

    file = path.name or str(path)
    try:
        _check_file(path, file)
        if path.suffix.lower() not in PARQUET_SUFFIXES:
            raise RecordingError(
                file, "", "only a Parquet file can be streamed: write the log as .parquet"
            )
        with path.open("rb") as opened:
            whole = opened.read(4) == PARQUET_MAGIC and opened.seek(-4, io.SEEK_END) > 0
            whole = whole and opened.read(4) == PARQUET_MAGIC
        if not whole:
            raise _broken_parquet(file)
        frame = pl.scan_parquet(path)
        rows = int(frame.select(pl.len()).collect().item())
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise _broken_parquet(file) from error
    except (OSError, ValueError) as error:
        raise _not_opened(file, error) from error
    if rows == 0:
        raise RecordingError(file, "", "the file holds no samples: export the log again")
    return frame, rows


def _check_file(path: Path, file: str) -> None:
    """Raise unless a path leads to an ordinary file."""
    if path.is_dir():
        raise RecordingError(file, "", "this is a folder: name the file in it")
    if not path.exists():
        raise RecordingError(file, "", "there is no such file: check the path and the spelling")
    if not path.is_file():
        raise RecordingError(file, "", "this is no ordinary file: copy the data into one")


def _not_opened(file: str, error: OSError | ValueError) -> RecordingError:
    reason = error.strerror if isinstance(error, OSError) else str(error)
    return RecordingError(
        file, "", f"the file cannot be opened ({reason}): check the path and its permissions"
    )


def _broken_parquet(file: str) -> RecordingError:
    return RecordingError(
        file, "", "this is no readable Parquet file: export it again, or name it .csv if it is text"
    )


def read_bytes(path: Path, limit: int, too_large_remedy: str) -> bytes:
    """Return the bytes of a file of at most `limit` bytes.

    Raises
    ------
    RecordingError
        If the path leads to no file, or the file is empty, too large or not to be opened.
    """
    file = path.name or str(path)
    try:
        _check_file(path, file)
        size = path.stat().st_size
        if size > limit:
            raise RecordingError(
                file,
                "",
                f"the file has {size / 1e6:.0f} MB, more than the {limit / 1e6:.4g} MB that are "
                f"read: {too_large_remedy}",
            )
        raw = path.read_bytes()
    except (OSError, ValueError) as error:
        raise _not_opened(file, error) from error
    if not raw.strip():
        raise RecordingError(file, "", "the file is empty: export the log again")
    return raw


def _read_csv(file: str, raw: bytes, digest: str) -> Table:
    import polars as pl

    text = _text_bytes(file, raw)
    blank = re.match(rb"\s*\n", text)
    skipped = text[: blank.end()].count(b"\n") if blank else 0
    head, _, body = text[blank.end() if blank else 0 :].partition(b"\n")
    line = skipped + 1
    header = head.decode("utf-8", errors="replace").rstrip("\r")
    separator = _separator(header)
    names = _header_names(file, line, header, separator)
    body = body.rstrip()
    if not body:
        raise RecordingError(
            file, f"line {line}", "no samples follow the header: export the log again"
        )
    try:
        frame = pl.read_csv(
            body, separator=separator, has_header=False, infer_schema=False,
            schema=dict.fromkeys(names, pl.String),
        )  # fmt: skip
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
        raise _unreadable_row(file, line, body, separator, len(names), names) from error
    if b'"' in body or frame[names[-1]].null_count():
        fault = _ragged_row(file, line, body, separator, len(names))
        if fault is not None:
            raise fault
    return Table(file, f"line {line}", line + 1, "line", frame, digest)


def _text_bytes(file: str, raw: bytes) -> bytes:
    """Return the bytes without byte-order mark, with line feeds, or say why they are no text."""
    if raw.startswith(PARQUET_MAGIC):
        raise RecordingError(
            file, "", "this is a Parquet file: rename it so that it ends in .parquet"
        )
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise RecordingError(file, "", "the text is UTF-16: save the file as UTF-8")
    sample = raw[:65536]
    if b"\0" in sample or sum(byte < 9 or 13 < byte < 32 for byte in sample) > 0.01 * len(sample):
        raise RecordingError(
            file, "", "this is a binary file, not text: export the log as CSV or Parquet"
        )
    text = raw.removeprefix(b"\xef\xbb\xbf")
    return text if b"\n" in text else text.replace(b"\r", b"\n")


def _separator(header: str) -> str:
    """Return the separator that occurs most often in the header, outside units and quotes."""
    bare = re.sub(r"\[[^\]]*\]|\"[^\"]*\"", "", header)
    return max(SEPARATORS, key=bare.count)


def _header_names(file: str, line: int, header: str, separator: str) -> list[str]:
    place = f"line {line}"
    try:
        row = next(csv.reader([header], delimiter=separator))
    except (csv.Error, StopIteration) as error:
        raise RecordingError(
            file, place, "the header cannot be read: write the column names there"
        ) from error
    names = [name.strip() or f"unnamed {number}" for number, name in enumerate(row, start=1)]
    if all(_is_number(name) for name in names):
        raise RecordingError(
            file, place, "the file begins with numbers: write a header with the column names first"
        )
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise RecordingError(
            file, place, f"the column {twice[0]!r} stands there twice: rename or remove one"
        )
    return names


def _ragged_row(
    file: str, header_line: int, body: bytes, separator: str, width: int
) -> RecordingError | None:
    """Return the first row whose number of cells differs from the header's, if there is one."""
    lines = io.TextIOWrapper(io.BytesIO(body), encoding="utf-8", errors="replace", newline="")
    reader = csv.reader(lines, delimiter=separator)
    line = header_line + 1
    try:
        for row in reader:
            place = f"line {line}"
            if not row:
                return RecordingError(file, place, "the line is blank: remove it")
            if len(row) != width:
                return RecordingError(
                    file,
                    place,
                    f"the row has {len(row)} cells where the header has {width}: complete or remove"
                    f" it, and write decimal points where there are decimal commas",
                )
            if reader.line_num + header_line != line:
                return RecordingError(file, place, "a quoted cell runs over several lines: mend it")
            line += 1
    except csv.Error as error:
        return RecordingError(file, f"line {line}", f"the row cannot be read ({error}): remove it")
    return None


def _unreadable_row(
    file: str, header_line: int, body: bytes, separator: str, width: int, names: list[str]
) -> RecordingError:
    fault = _ragged_row(file, header_line, body, separator, width)
    if fault is not None:
        return fault
    for number, line in enumerate(body.split(b"\n"), start=header_line + 1):
        try:
            line.decode("utf-8")
        except UnicodeDecodeError:
            return RecordingError(file, f"line {number}", "the text is not UTF-8: save it as UTF-8")
    return RecordingError(
        file, "", f"the rows below {names[0]!r} do not form a table: export the log as plain CSV"
    )


def _read_parquet(file: str, raw: bytes, digest: str) -> Table:
    import polars as pl

    broken = _broken_parquet(file)
    if not (raw.startswith(PARQUET_MAGIC) and raw.endswith(PARQUET_MAGIC)):
        raise broken
    try:
        count = int(pl.scan_parquet(io.BytesIO(raw)).select(pl.len()).collect().item())
        if count > MOST_ROWS:
            raise RecordingError(
                file,
                "",
                f"the file has {count} rows, more than the {MOST_ROWS} that are read at once: "
                f"identify it with --stream, or cut the log into shorter files",
            )
        frame = pl.read_parquet(io.BytesIO(raw))
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
        raise broken from error
    if frame.width == 0 or frame.height == 0:
        raise RecordingError(file, "", "the file holds no samples: export the log again")
    return Table(file, "", 1, "row", frame, digest)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _bad_cell(cell: object) -> str:
    """Say what is wrong with a cell that is no finite number."""
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        return "the cell is empty: fill it in, or remove the row"
    text = str(cell).strip()
    shown = text if len(text) <= 24 else text[:21] + "..."
    if _is_number(text):
        return f"{shown} is not a finite number: remove the row"
    if re.fullmatch(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?", text):
        return f"{shown!r} has a decimal comma: export with decimal points"
    if re.match(r"\d{4}-\d\d|\d{1,2}[:.]\d\d[:.]\d\d", text):
        return f"{shown!r} is a date or a time of day: write seconds since the start"
    return f"{shown!r} is not a number: correct it, or remove the row"
