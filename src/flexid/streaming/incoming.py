"""Samples as they come: from lines of text, or from a whole log that is played again."""

import time
from collections.abc import Iterable
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
from flexid.streaming.sources import WAIT, Source
from flexid.streaming.text_stream import TextStream

BLOCK = 65_536  # rows of a log that are read at once
LONGEST_WAIT = 1.0  # seconds for one sample, beyond the longest sample time of a drive


class TextSamples(TextStream):
    """Samples from lines of text that a source gives."""

    def __init__(self, source: Source, column_map: MapSource | None = None, **options: Any) -> None:
        super().__init__(source.name, column_map, **options)
        self._source = source
        self._ended = False
        self.warnings: tuple[str, ...] = ()
        self.begins = False  # whether what was read last begins another text

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
        self.begins = self._source.begins
        if self.begins:
            self._warn("it was rewritten, and is read from its beginning")
            self._warn_of_rest()
            self.begin_again()
        self._ended = data is None or last
        samples = self.samples(data or b"", ended=self._ended)
        if data is None:
            self._warn_of_rest()
        if self.left_out:
            self._warn(
                "it ended before another header and three samples, and what came is left out"
            )
        return np.empty((0, 0)) if samples is None else samples

    def _warn_of_rest(self) -> None:
        if self.rest.strip():
            self._warn(
                "its last line has no end, so it may be half a sample, and is left out: end each "
                "line"
            )

    def _warn(self, what: str) -> None:
        self.warnings = tuple(dict.fromkeys((*self.warnings, f"{self.name}: {what}")))

    def close(self) -> None:
        """Close the source."""
        self._source.close()


class Pace:
    """Due times of samples that are played again: as they came, but for jumps of the clock.

    A jump ahead takes `LONGEST_WAIT`, one back no time; what is late by less comes with what was
    before it.
    """

    def __init__(self) -> None:
        self.jumps = 0  # times at which the clock jumped ahead by more than is waited for
        self._time: float | None = None  # latest stamp that others are compared with
        self._due = 0.0  # when that is

    def due(self, times: FloatArray) -> FloatArray:
        """When the next samples are due, in s after the first of all; never less than before."""
        found = np.empty(len(times))
        for place, stamp in enumerate(times.tolist()):
            step = 0.0 if self._time is None else stamp - self._time
            self.jumps += step > LONGEST_WAIT
            if self._time is None or step > 0.0 or step < -LONGEST_WAIT:
                self._time = stamp
                self._due += min(max(step, 0.0), LONGEST_WAIT)
            found[place] = self._due
        return found


class Replay:
    """A whole log, read in parts where it can be, whose samples come again when they came."""

    begins = False

    def __init__(
        self, path: Path, column_map: MapSource | None, *, at_once: bool, model: str = "auto"
    ) -> None:
        self.name = shown(path)
        self._at_once = at_once
        self._tables = tables_of_file(path, column_map, BLOCK)
        self._clock, self._pace = Clock(since_1970=True), Pace()
        table = next(self._tables)
        recipes, warnings = recipes_of(table, column_map)
        channels = channels_of(table, recipes, self._clock)
        self.warnings = tuple(dict.fromkeys(table.warnings + warnings))
        self.channels = chosen_channels(self.name, channels, self.warnings, model)
        self._recipes = {name: recipes[name] for name in self.channels.sampled}
        self._take(self.channels.sampled.values())
        self._begun = time.monotonic()

    def read(self, *, last: bool) -> FloatArray | None:  # noqa: ARG002 - nothing is kept back
        """Samples whose time has come, of one block at most."""
        if self._taken == len(self._samples) and not self._next_block():
            return None
        stop = len(self._samples)
        if not self._at_once:
            now = time.monotonic() - self._begun
            if self._due[self._taken] > now:
                time.sleep(WAIT)
                now = time.monotonic() - self._begun
            stop = int(np.searchsorted(self._due, now, side="right"))
        found = self._samples[self._taken : stop]
        self._taken = max(self._taken, stop)
        return found

    def _next_block(self) -> bool:
        table = next(self._tables, None)
        if table is None:
            return False
        self.warnings = tuple(dict.fromkeys(self.warnings + table.warnings))
        self._take(channels_of(table, self._recipes, self._clock).values())
        return True

    def _take(self, channels: Iterable[Channel]) -> None:
        """Hold the samples of the next block, and when they are due."""
        self._samples = np.column_stack([channel.values for channel in channels])
        self._taken, self._due = 0, self._pace.due(self._samples[:, 0])
        if self._pace.jumps and not self._at_once:
            sentence = (
                f"{self.name}: its time stamps jump ahead by more than {LONGEST_WAIT:g} s, and no "
                f"longer than that is waited for: samples.gaps counts such places"
            )
            self.warnings = tuple(dict.fromkeys((*self.warnings, sentence)))

    def close(self) -> None:
        """Read no more."""
        self._tables.close()


Incoming: TypeAlias = TextSamples | Replay
"""Samples as they come: `read` returns none if none have come for a while, None if none will."""


def is_whole_log(source: str) -> bool:
    """Whether a source is a file, or the folder of a bag, that cannot grow line by line."""
    if source == "-" or "://" in source:
        return False
    return format_of(Path(source)) is not None or Path(source).is_dir()
