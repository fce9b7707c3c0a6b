"""Sources of samples in SI units: a growing text file, standard input, or a whole log."""

from __future__ import annotations

import io
import os
import select
import sys
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError, SettingError
from flexid.files import check_file, shown
from flexid.readers.formats import format_of
from flexid.recording.columns import channels_of, read_channels, recipes_of
from flexid.recording.layout import BLANK, LONGEST_LINE, Layout, layout_of, split
from flexid.recording.read import tables_of_file
from flexid.recording.recipes import MapSource
from flexid.recording.recording import Channel
from flexid.recording.sampling import GAP, check_typical
from flexid.recording.table import Clock, Table, decimal_mark
from flexid.recording.text import COMMENT_MARKS, UTF_16, as_utf_8, read_text
from flexid.streaming.options import StreamChannels, chosen_channels

if TYPE_CHECKING:
    import polars

BLOCK = 65_536  # rows of a log that are read at once
HEAD_LINES = 200  # lines at the beginning that determine layout and sample time
LINES_FOR_LAYOUT = 8  # lines that determine the layout if the sample time is given
FEWEST_LINES = 4  # of a stream that has ended: a header and three samples


class _Columns:
    """Channels of a stream's tables, determined by the first table; all share one clock."""

    def __init__(self, name: str, table: Table, column_map: MapSource | None, model: str) -> None:
        self._clock = Clock(since_1970=True)
        recipes, warnings = recipes_of(table, column_map)
        channels = channels_of(table, recipes, self._clock)
        self.channels = chosen_channels(name, channels, warnings, model)
        self.first = _stacked(self.channels.sampled)  # samples of the first table
        self._recipes = {name: recipes[name] for name in self.channels.sampled}

    def samples(self, table: Table) -> FloatArray:
        """Return the samples of a later table, shape (n, n_values)."""
        return _stacked(channels_of(table, self._recipes, self._clock))


class TextStream:
    """Conversion of text, received as bytes, to samples."""

    def __init__(
        self,
        name: str,  # for messages
        column_map: MapSource | None = None,
        *,
        model: str = "auto",  # of the joint
        header: str | None = None,  # names of the columns, if the text has no header
        fewest: int = HEAD_LINES,  # lines to wait for before the layout is determined
    ) -> None:
        self.name, self._column_map, self._model = name, column_map, model
        self._fewest = fewest
        self._head = [] if header is None else [header.strip(" \r\n").encode()]
        self.rest = b""  # the last line, still incomplete
        self._layout: Layout | None = None
        self._columns: _Columns | None = None  # None until they are known
        self._mark = "."  # decimal mark
        self.warnings: tuple[str, ...] = ()

    @property
    def channels(self) -> StreamChannels | None:
        """Channels of a sample; None until they are known."""
        return self._columns.channels if self._columns else None

    def samples(self, data: bytes, *, ended: bool = False) -> FloatArray:
        """Return the samples of complete lines, shape (n, n_values); none before the columns."""
        if len(self.rest) > LONGEST_LINE:
            raise self._refusal(
                f"a line has more than {LONGEST_LINE} bytes: send one line for each sample"
            )
        *lines, self.rest = (self.rest + data).split(b"\n")
        if ended and self.rest.endswith(b"\r"):
            lines.append(self.rest)
            self.rest = b""
        if self._layout is not None and self._columns is not None:
            return self._samples(self._layout, self._columns, lines)
        self._head += lines
        if len(self._head) < self._fewest and not ended:
            return np.empty((0, 0))
        if len(self._head) < FEWEST_LINES:
            raise self._refusal("it ended before a header and three samples: send more lines")
        return self._first_samples(self._head)

    def _refusal(self, reason: str) -> RecordingError:
        return RecordingError(self.name, "", reason)

    def _first_samples(self, lines: list[bytes]) -> FloatArray:
        """Determine layout and columns from the first lines, and return their samples."""
        text = b"\n".join(lines) + b"\n"
        if text.startswith(UTF_16):
            raise self._refusal("the text is in UTF-16: send it in UTF-8")
        text = as_utf_8(self.name, text)
        self._layout = layout = layout_of(self.name, text)
        # Further lines may arrive now or later, so only the first `fewest` lines may decide.
        head = b"\n".join(text.split(b"\n")[: self._fewest]) + b"\n"
        frame = layout.without_twins(self.name, _frame(layout, head[layout.start :].split(b"\n")))
        self._mark = decimal_mark(frame) or "."
        table = layout.table(self.name, frame, self._mark)
        self._columns = columns = _Columns(self.name, table, self._column_map, self._model)
        self.warnings = columns.channels.warnings
        samples = columns.first
        if 2 * np.count_nonzero(np.isnan(samples).any(axis=1)) > len(samples):
            read_channels(read_text(self.name, head), self._column_map)  # raises for a bad cell
        rest = text[len(head) :].split(b"\n")
        return np.concatenate((samples, self._samples(layout, columns, rest)))

    def _samples(self, layout: Layout, columns: _Columns, lines: list[bytes]) -> FloatArray:
        """Return the samples of lines; NaN where a cell is not a number. Skip comments."""
        frame = _frame(layout, lines)
        if not frame.height:
            return np.empty((0, columns.first.shape[1]))
        return columns.samples(layout.table(self.name, frame, self._mark))


class TextSamples(TextStream):
    """Iterator over blocks of samples from a text source; a block is empty while none arrive."""

    def __init__(
        self,
        source: str,
        column_map: MapSource | None = None,
        *,
        stop_at_end: bool = False,
        **options: Any,
    ) -> None:
        name = "standard input" if source == "-" else shown(Path(source))
        super().__init__(name, column_map, **options)
        self._source = open_source(source, stop_at_end=stop_at_end)

    def __iter__(self) -> Iterator[FloatArray]:
        try:
            for data in self._source:
                yield self.samples(data)
        except OSError as error:
            raise self._refusal(
                f"it cannot be read on ({error.strerror}): check the disk or the connection"
            ) from error
        last = self.samples(b"", ended=True)
        if self.rest.strip():
            self.warnings += (
                f"{self.name}: its last line has no end, so it may be incomplete, and is left "
                f"out: end each line",
            )
        yield last

    def close(self) -> None:
        """Close the source."""
        self._source.close()


class Replay:
    """Iterator over the samples of a whole log, in blocks if its format can be read in parts."""

    def __init__(self, path: Path, column_map: MapSource | None, model: str = "auto") -> None:
        self.name = shown(path)
        self._tables = tables_of_file(path, column_map, BLOCK)
        table = next(self._tables)
        self._columns = _Columns(self.name, table, column_map, model)
        self.channels = self._columns.channels
        self.warnings = table.warnings + self.channels.warnings  # of the latest block

    def __iter__(self) -> Iterator[FloatArray]:
        yield self._columns.first
        for table in self._tables:
            self.warnings = table.warnings
            yield self._columns.samples(table)

    def close(self) -> None:
        """Stop reading and close the file."""
        self._tables.close()


def _stacked(channels: Mapping[str, Channel]) -> FloatArray:
    return np.column_stack([channel.values for channel in channels.values()])


def is_whole_log(source: str) -> bool:
    """Return whether a source is a file or a bag's folder that cannot grow line by line."""
    if source == "-" or "://" in source:
        return False
    return format_of(Path(source)) is not None or Path(source).is_dir()


def _frame(layout: Layout, lines: list[bytes]) -> polars.DataFrame:
    """Return the cells of all lines but blank ones and comments; null in a malformed line."""
    import polars as pl

    rows = [_cells(layout, line) for line in lines if _may_be_row(line)]
    columns = zip(*rows, strict=True) if rows else [()] * len(layout.names)
    return pl.DataFrame(
        [pl.Series(name, own, pl.String) for name, own in zip(layout.names, columns, strict=True)]
    )


def _cells(layout: Layout, line: bytes) -> Sequence[str | None]:
    text = line.decode("utf-8", "replace").rstrip("\r\n").replace("\N{MINUS SIGN}", "-")
    if '"' in text:
        cells = [cell.strip('"') for cell in split(text, layout.separator)]
    else:
        cells = text.split(None if layout.separator == BLANK else layout.separator)
    return cells if len(cells) == len(layout.names) else [None] * len(layout.names)


def _may_be_row(line: bytes) -> bool:
    """Whether a line is neither blank nor a comment."""
    stripped = line.strip()
    return bool(stripped) and not stripped.startswith(COMMENT_MARKS)


def sample_time_of(source: str, time: FloatArray) -> float:
    """Return the sample time in s: the mean of the regular steps between the first time stamps."""
    steps = np.diff(time[np.isfinite(time)])
    steps = steps[steps > 0.0]
    if not len(steps):
        raise RecordingError(
            source,
            "time",
            "its first time stamps do not increase: write them with more digits, or give the "
            "sample time",
        )
    typical = float(np.median(steps))
    even = steps[np.abs(steps / typical - 1.0) < GAP - 1.0]
    found = float(even.mean()) if len(even) else typical
    check_typical(source, "time", found, steps)
    return found


WAIT = 0.1  # s after which a source without new data yields an empty block
MOST = 1 << 20  # largest block in bytes

_COMPARED = 256  # last bytes read, which are compared to detect that the file was rewritten


def open_source(source: str, *, stop_at_end: bool = False) -> Generator[bytes]:
    """Yield the bytes of a source as they arrive; raise if it cannot be opened."""
    if source == "-":
        return _standard_input()
    if "://" in source:
        raise SettingError(
            "source",
            f"{source!r} cannot be opened: give the path of a file, or - and let another program "
            f"write to standard input",
        )
    return _growing_file(Path(source), stop_at_end=stop_at_end)


def _growing_file(path: Path, *, stop_at_end: bool) -> Generator[bytes]:
    """Yield the bytes appended to a text file; raise if earlier text was changed."""
    name = shown(path)
    check_file(path, "a log as text", lambda reason: RecordingError(name, "", reason))
    try:
        file = path.open("rb", buffering=0)
    except OSError as error:
        raise RecordingError(
            name, "", f"the file cannot be opened ({error.strerror}): check its rights"
        ) from None
    last = b""  # latest bytes read: they differ in a file that was rewritten and is longer now
    with file:
        while True:
            file.seek(-len(last), os.SEEK_CUR)
            found = file.read(len(last) + MOST)
            new = found.removeprefix(last)
            if not found.startswith(last) or (not new and _is_replaced(path, file)):
                raise RecordingError(
                    name,
                    "",
                    "it was cut, rewritten or replaced while it was watched: watch it once more",
                )
            last = found[-_COMPARED:]
            if not new and stop_at_end:
                return
            if not new:
                time.sleep(WAIT)
            yield new


def _is_replaced(path: Path, file: io.FileIO) -> bool:
    """Whether the path now names another file, for example after a log rotation."""
    try:
        return not os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except OSError:  # the new file does not exist yet
        return False


def _standard_input() -> Generator[bytes]:
    """Yield the bytes from standard input, which stays open for other readers."""
    try:
        file = sys.stdin.fileno()
    except (AttributeError, ValueError, io.UnsupportedOperation):
        raise SettingError("source", "there is no standard input: give a file") from None
    while True:  # on Windows `select` takes no console, so reading blocks
        if os.name == "posix" and not select.select([file], [], [], WAIT)[0]:
            yield b""
        elif found := os.read(file, MOST):
            yield found
        else:
            return
