"""Samples as they come: from lines of text, or from a whole log."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.files import shown
from flexid.readers.formats import format_of
from flexid.recording.channel import Channel
from flexid.recording.clock import Clock
from flexid.recording.columns import channels_of, recipes_of
from flexid.recording.recipes import MapSource
from flexid.recording.series import tables_of_file
from flexid.streaming.options import chosen_channels
from flexid.streaming.sources import Source
from flexid.streaming.text_stream import TextStream

BLOCK = 65_536  # rows of a log that are read at once


class TextSamples(TextStream):
    """Samples from lines of text that a source gives."""

    def __init__(self, source: Source, column_map: MapSource | None = None, **options: Any) -> None:
        super().__init__(source.name, column_map, **options)
        self._source = source
        self._ended = False
        self.warnings: tuple[str, ...] = ()

    def read(self, *, last: bool) -> FloatArray | None:
        """Samples of the lines that came."""
        if self._ended:
            return None
        try:
            data = self._source.read()
        except OSError as error:
            raise RecordingError(
                self.name,
                "",
                f"it cannot be read on ({error.strerror}): check the disk or the connection",
            ) from error
        self._ended = data is None or last
        samples = self.samples(data or b"", ended=self._ended)
        if data is None and self.rest.strip():
            self.warnings = (
                f"{self.name}: its last line has no end, so it may be half a sample, and is left "
                f"out: end each line",
            )
        return np.empty((0, 0)) if samples is None else samples

    def close(self) -> None:
        """Close the source."""
        self._source.close()


class Replay:
    """A whole log, read in parts where it can be."""

    def __init__(self, path: Path, column_map: MapSource | None, model: str = "auto") -> None:
        self.name = shown(path)
        self._tables = tables_of_file(path, column_map, BLOCK)
        self._clock = Clock(since_1970=True)
        table = next(self._tables)
        recipes, warnings = recipes_of(table, column_map)
        channels = channels_of(table, recipes, self._clock)
        self.warnings = tuple(dict.fromkeys(table.warnings + warnings))
        self.channels = chosen_channels(self.name, channels, self.warnings, model)
        self._recipes = {name: recipes[name] for name in self.channels.sampled}
        self._next: FloatArray | None = _samples(self.channels.sampled)

    def read(self, *, last: bool) -> FloatArray | None:  # noqa: ARG002 - nothing is kept back
        """The samples of a block."""
        found, self._next = self._next, None
        if found is None and (table := next(self._tables, None)) is not None:
            self.warnings = tuple(dict.fromkeys(self.warnings + table.warnings))
            found = _samples(channels_of(table, self._recipes, self._clock))
        return found

    def close(self) -> None:
        """Read no more."""
        self._tables.close()


def _samples(channels: Mapping[str, Channel]) -> FloatArray:
    return np.column_stack([channel.values for channel in channels.values()])


Incoming: TypeAlias = TextSamples | Replay
"""Samples as they come: `read` returns none if none have come for a while, None if none will."""


def is_whole_log(source: str) -> bool:
    """Whether a source is a file, or the folder of a bag, that cannot grow line by line."""
    if source == "-" or "://" in source:
        return False
    return format_of(Path(source)) is not None or Path(source).is_dir()
