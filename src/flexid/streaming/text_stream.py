"""From bytes as they come to samples in SI units: lines of numbers, with columns as in a log.

Header, units, separators and column maps are those of a log's text; the stream's first lines decide
on them, and on the sample time. A line that is no row of numbers becomes a sample without any,
which is counted.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording.channel import Channel
from flexid.recording.clock import is_stamp
from flexid.recording.column_map import MapSource
from flexid.recording.columns import read_channels
from flexid.recording.layout import (
    BLANK,
    LONGEST_LINE,
    Layout,
    header_separator,
    is_number,
    layout_of,
    split,
)
from flexid.recording.sampling import GAP, LONGEST_SAMPLE_TIME, SHORTEST_SAMPLE_TIME
from flexid.recording.table import EXAMPLE, Table
from flexid.recording.text import UTF_16, as_utf_8, read_text
from flexid.streaming.channels import StreamChannels, chosen_channels
from flexid.streaming.text_rows import RowReader, mark_of, stamped_in

HEAD_LINES = 200
"""Lines at the beginning from which layout and sample time are taken."""

LINES_FOR_LAYOUT = 8
"""Lines from which the layout alone is taken, where the sample time is known."""

FEWEST_LINES = 4
"""The fewest of them: a header and three samples, where the stream has ended."""


@dataclass(frozen=True, eq=False)
class StreamColumns:
    """What a stream's columns are: samples are ``weights @ cells + offsets``."""

    # (n_values, n_columns): in SI units; the values are time, positions and input
    weights: FloatArray
    offsets: FloatArray  # (n_values,)
    channels: StreamChannels  # what the values are

    @property
    def used(self) -> list[int]:
        """The columns of which any value is made."""
        return np.flatnonzero(self.weights.any(axis=0)).tolist()

    def samples(self, cells: FloatArray) -> FloatArray:
        """Samples, shape (n, n_values), from cells, shape (n, n_columns)."""
        samples = np.empty((len(cells), len(self.weights)))
        with np.errstate(all="ignore"):  # of numbers that no drive has, which the guard refuses
            for place, weights in enumerate(self.weights):
                used = weights != 0.0  # a bad cell elsewhere does no harm
                samples[:, place] = cells[:, used] @ weights[used] + self.offsets[place]
        return samples


def stream_columns(
    source: str, layout: Layout, column_map: MapSource | None, model: str = "auto"
) -> StreamColumns:
    """Decide what the columns of a stream are, exactly as for a log."""
    import polars as pl

    names = layout.names
    stamps = {names[column] for column in layout.stamped}
    frame = pl.DataFrame({name: [EXAMPLE if name in stamps else "0"] for name in names})
    table = Table(source, f"line {layout.header_line}", layout.first_line, "line", frame, "")
    channels, warnings = read_channels(table, column_map)
    chosen, meant = chosen_channels(source, channels, warnings, model)
    return StreamColumns(
        np.array([_weights(channel, names) for channel in chosen]),
        np.array([channel.origin.offset for channel in chosen]),
        meant,
    )


def _weights(channel: Channel, names: tuple[str, ...]) -> list[float]:
    origin = channel.origin
    return [origin.factor * origin.columns.get(name, 0.0) for name in names]


@dataclass(frozen=True)
class TextBefore:
    """The text that another one follows, maybe without a header of its own."""

    rows: RowReader  # what read it
    used: list[int]  # columns that have to hold numbers


@dataclass
class LineReader:
    """Cells from bytes as they come."""

    source: str  # for messages
    header: str | None = None  # names of the columns, where the stream does not begin with them
    fewest: int = HEAD_LINES  # lines that are waited for before the layout is decided
    before: TextBefore | None = None  # the text that this one follows
    rows: RowReader | None = None  # what reads them, as soon as there is a layout
    left_out: int = 0  # lines at the end that were too few to say what their columns are
    head: bytes = b""  # the lines by which that was decided, as text in UTF-8
    _rest: bytes = b""
    _first: list[bytes] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.header is not None:
            self._first.append(self.header.strip(" \r\n").encode())

    def cells(self, data: bytes, *, ended: bool = False) -> FloatArray | None:
        """Cells of the lines that are complete, shape (n, n_columns); None until there is a layout.

        A text that follows another and ends too soon has none: see `left_out`.
        """
        if len(self._rest) > LONGEST_LINE:
            raise RecordingError(
                self.source,
                "",
                f"a line has more than {LONGEST_LINE} bytes: send one line for each sample",
            )
        *lines, self._rest = (self._rest + data).split(b"\n")
        if ended and self._rest.endswith(b"\r"):
            lines.append(self._rest)
            self._rest = b""
        if self.rows is None:
            self._first += lines
            if len(self._first) < self.fewest and not ended:
                return None
            if len(self._first) < FEWEST_LINES and not self._goes_on_with(self._first):
                if self.before is not None:
                    self.left_out = len(self._first)
                    return None
                raise RecordingError(
                    self.source, "", "it ended before a header and three samples had come"
                )
            lines, self._first = self._first, []
            self.rows, lines = self._begun(lines)
        return self.rows.numbers(lines)

    @property
    def layout(self) -> Layout | None:
        """Names and their place, as soon as they are known."""
        return None if self.rows is None else self.rows.layout

    def check_head(self, columns: StreamColumns, column_map: MapSource | None) -> None:
        """Raise as for a log, where most of the first lines are no rows of numbers."""
        rows = self.rows
        if rows is None or not self.head:
            return
        lines = self.head[rows.layout.start :].split(b"\n")
        if not rows.most_are_rows(lines, columns.used):
            layout, frame = read_text(self.source, self.head)
            place = f"line {layout.header_line}"
            table = Table(self.source, place, layout.first_line, "line", frame, "")
            read_channels(table, column_map)
        self.head = b""

    @property
    def rest(self) -> bytes:
        """The line that has not ended yet."""
        return self._rest

    def _begun(self, lines: list[bytes]) -> tuple[RowReader, list[bytes]]:
        """What reads the rows, by the first lines, and those of them that hold numbers."""
        if self.before is not None and self._goes_on_with(lines):
            return self.before.rows.again(), lines
        if self.header is not None:
            self._check_own_header(self.header, lines[1])
            if _is_part(*lines[1:3], header=self.header):
                del lines[1]
        text = b"\n".join(lines) + b"\n"
        if text.startswith(UTF_16):
            raise RecordingError(self.source, "", "the text is in UTF-16: send it in UTF-8")
        text = as_utf_8(self.source, text)
        layout = layout_of(self.source, text)
        # The rest of them may come now or later: nothing may depend on that.
        self.head = b"\n".join(text.split(b"\n")[: self.fewest]) + b"\n"
        first = self.head[layout.start :].split(b"\n")
        layout = replace(layout, stamped=stamped_in(first, layout))
        before = None if self.before is None else self.before.rows
        rows = RowReader(layout, mark_of(first, layout), before)
        return rows, text[layout.start :].split(b"\n")

    def _check_own_header(self, header: str, first: bytes) -> None:
        """Raise where the stream begins with names, though others are given."""
        separator = _separator(header)
        names = split(first.decode("utf-8", "replace"), separator)
        numbers = sum(is_number(name) or is_stamp(name) or not name for name in names)
        if len(names) == len(split(header, separator)) and not numbers:
            raise RecordingError(
                self.source,
                "line 1",
                f"it begins with column names of its own, {', '.join(names)}, and others are given "
                f"as its header: leave the header out, or give the names in a column map",
            )

    def _goes_on_with(self, lines: list[bytes]) -> bool:
        """Whether lines begin with a row of the text before: with no names where numbers stood."""
        if self.before is None:
            return False
        first = self.before.rows.again().numbers(lines[: self.fewest])[:1, self.before.used]
        return bool(first.size and np.isfinite(first).all())


def _is_part(line: bytes, following: bytes, *, header: str) -> bool:
    """Whether a line has fewer cells than the next: a stream without header, joined mid-line."""
    first, second = (
        len(split(text.decode("utf-8", "replace"), _separator(header)))
        for text in (line, following)
    )
    return first < second


def _separator(header: str) -> str:
    separator = header_separator(header)
    return separator if separator in header else BLANK


def sample_time_of(source: str, time: FloatArray) -> float:
    """Sample time from the first time stamps: their slope, but for what is missing or late."""
    steps = np.diff(time[np.isfinite(time)])
    steps = steps[steps > 0.0]
    if len(steps):
        typical = float(np.median(steps))
        even = steps[np.abs(steps / typical - 1.0) < GAP - 1.0]
        found = float(even.mean()) if len(even) else typical
        if SHORTEST_SAMPLE_TIME <= found <= LONGEST_SAMPLE_TIME:
            return found
    raise RecordingError(
        source,
        "time",
        "its first time stamps do not increase as those of a drive do: name the unit of the time, "
        "as in [ms], write it with more digits, or give the sample time",
    )
