"""Samples as they come: from lines of text, or from a whole log that is played again."""

import time
from pathlib import Path
from typing import Protocol

import numpy as np

from flexid.arrays import FloatArray
from flexid.files import shown
from flexid.recording.column_map import MapSource
from flexid.recording.columns import read_channels
from flexid.recording.formats import SERIES, table_of_file
from flexid.streaming.channels import StreamChannels, chosen_channels
from flexid.streaming.sources import TURN, Source
from flexid.streaming.text_stream import LineReader, StreamColumns, stream_columns

WHOLE_LOGS = {*SERIES, ".parquet", ".pq"}
"""Ends of the names of files that do not grow line by line, and are played again."""


class Incoming(Protocol):
    """Samples as they come."""

    @property
    def name(self) -> str:
        """How messages name it."""
        ...

    @property
    def channels(self) -> StreamChannels | None:
        """What the values of a sample are; None until some have come."""
        ...

    def read(self, *, last: bool) -> FloatArray | None:
        """Samples that have come; empty if none have for a while, None if none will.

        Parameters
        ----------
        last : bool
            Whether nothing will be asked for after this.
        """
        ...

    def close(self) -> None:
        """Give back what was opened."""
        ...


class TextSamples:
    """Samples from lines of text.

    Parameters
    ----------
    source : Source
        Of bytes.
    lines : LineReader
        What makes cells of them.
    column_map : path, mapping or None
        A column map.
    """

    def __init__(self, source: Source, lines: LineReader, column_map: MapSource | None) -> None:
        self.name = source.name
        self._source, self._lines, self._map = source, lines, column_map
        self._columns: StreamColumns | None = None
        self._ended = False

    @property
    def channels(self) -> StreamChannels | None:
        """What the header says."""
        return None if self._columns is None else self._columns.channels

    def read(self, *, last: bool) -> FloatArray | None:
        """Samples of the lines that came."""
        if self._ended:
            return None
        data = self._source.read()
        self._ended = data is None or last
        cells = self._lines.cells(data or b"", ended=self._ended)
        if cells is None:
            return np.empty((0, 0))
        if self._columns is None:
            assert self._lines.layout is not None
            self._columns = stream_columns(self.name, self._lines.layout, self._map)
        return self._columns.samples(cells)

    def close(self) -> None:
        """Close the source."""
        self._source.close()


class Replay:
    """A whole log, an MCAP file for example, whose samples come again when they came.

    Parameters
    ----------
    path : Path
        The log.
    column_map : path, mapping or None
        A column map.
    at_once : bool
        Whether its samples come as fast as they are taken.

    Raises
    ------
    RecordingError
        If it cannot be read.
    """

    def __init__(self, path: Path, column_map: MapSource | None, *, at_once: bool) -> None:
        self.name = shown(path)
        table = table_of_file(path, column_map)
        channels, warnings = read_channels(table, column_map)
        warnings = tuple(dict.fromkeys(table.warnings + warnings))
        chosen, self.channels = chosen_channels(self.name, channels, warnings)
        self._samples: FloatArray = np.column_stack([channel.values for channel in chosen])
        # The latest time so far: a sample that is late, or another clock, holds nobody up.
        self._due = np.maximum.accumulate(self._samples[:, 0])
        self._at_once = at_once
        self._begun = time.monotonic()
        self._taken = 0

    def read(self, *, last: bool) -> FloatArray | None:  # noqa: ARG002 - nothing is kept back
        """Samples whose time has come."""
        if self._taken == len(self._samples):
            return None
        stop = len(self._samples)
        if not self._at_once:
            time.sleep(TURN)
            now = self._due[0] + time.monotonic() - self._begun
            stop = int(np.searchsorted(self._due, now, side="right"))
        found = self._samples[self._taken : stop]
        self._taken = max(self._taken, stop)
        return found

    def close(self) -> None:
        """Nothing is open."""


def is_whole_log(source: str) -> bool:
    """Whether a source is a file, or the folder of a bag, that cannot grow line by line."""
    if source == "-" or "://" in source:
        return False
    return Path(source).suffix.lower() in WHOLE_LOGS or Path(source).is_dir()
