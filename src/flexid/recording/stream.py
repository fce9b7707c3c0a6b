"""A Parquet file as a stream of checked recordings, for logs that no memory holds.

What needs the whole log in `flexid.recording.read.read_log` is looked at in its beginning, the
head; what a single sample can do wrong is looked at in every chunk.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.files import sha256, shown
from flexid.readers.formats import PARQUET
from flexid.readers.guard import Reading
from flexid.recording import checks, wraps
from flexid.recording.channel import VELOCITIES
from flexid.recording.clock import Clock
from flexid.recording.columns import read_channels
from flexid.recording.frozen import Still
from flexid.recording.names import MOST_TIMES, first_times
from flexid.recording.read import ENCODERS, add_link_position, log_of_table, recording_of
from flexid.recording.sampling import EVEN, GAP, MOST_GAPS
from flexid.recording.series import names_of, tables_of, tables_of_file

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from flexid.arrays import FloatArray
    from flexid.recording.channel import Channel
    from flexid.recording.column_map import MapSource
    from flexid.recording.recording import Log, Recording
    from flexid.recording.table import Table

CHUNK = 262_144
"""Rows that are read at once."""

_DRIFT = 1e-6  # relative change of the sample time from the head to the whole that is worth a word


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive samples of a stream."""

    recording: Recording  # one sample or more, in SI units
    begins: bool  # whether a recording begins here: at the beginning, or after a gap
    row: int  # rows of the file before it


class LogStream:
    """A log that is read chunk by chunk, once."""

    def __init__(self, path: Path, columns: MapSource | None, head_rows: int) -> None:
        self.file, self.rows, table = _head(path, columns, head_rows)
        self.warnings: list[str] = []
        """What was found in the stream, once it is over."""
        self._path = path
        self._map = columns
        self._clock = Clock()
        self.head_rows = table.frame.height
        """Rows that were read and checked at once."""
        self.head: Log = log_of_table(table, columns, self._clock)
        self.sample_time = self.head.recordings[0].sample_time
        self.sha256 = ""
        """Digest of the file's bytes, once the stream is over."""

    def chunks(self, size: int = CHUNK) -> Iterator[Chunk]:
        """Read, check and convert."""
        state = _State(self.file, self.sample_time, self.head)
        with ThreadPoolExecutor(1) as digests:
            digest = digests.submit(sha256, self._path)
            for table in tables_of_file(self._path, self._map, size):
                channels, _ = read_channels(table, self._map, self._clock)
                yield from state.chunks(table, channels)
            self.warnings += state.finished(self.rows)
            self.sha256 = digest.result()


def _head(path: Path, columns: MapSource | None, rows: int) -> tuple[str, int, Table]:
    """Name of a Parquet file, its number of rows, and so many of them."""
    if path.suffix.lower() not in PARQUET.suffixes:
        reason = "only a Parquet file can be streamed: write the log as .parquet"
        raise RecordingError(shown(path), "", reason)
    with Reading(path) as reading:
        names_of(reading)
        return (
            reading.file,
            reading.series[0].length,
            next(tables_of(reading, columns, min(rows, reading.series[0].length))),
        )


@dataclass
class _State:
    """What is carried from chunk to chunk."""

    file: str
    sample_time: float
    head: Log
    last_time: float = np.nan
    steps: int = 0
    elapsed: float = 0.0
    gaps: list[str] = field(default_factory=list)
    n_gaps: int = 0
    wraps: dict[str, wraps.Wraps] = field(default_factory=dict)
    still: dict[str, Still] = field(default_factory=dict)

    def chunks(self, table: Table, channels: dict[str, Channel]) -> Iterator[Chunk]:
        """Turn a table into chunks, cut at the gaps."""
        row = table.first_row - 1
        clock = channels.pop("time")
        checks.check_magnitude(self.file, "time", clock)
        for name, channel in channels.items():
            checks.check_magnitude(self.file, name, channel)
        begins = self._begins(table, clock.column, clock.values)
        for name in ENCODERS:
            if name in channels:
                if name not in self.wraps:
                    self.wraps[name] = self._wraps(name, channels[name])
                channels[name] = self.wraps[name].undone(channels[name], clock.values)
        add_link_position(channels)
        self._watch(channels, clock.values)
        for name in VELOCITIES:  # what the head of the log shows to be wrong is not used
            if getattr(self.head.recordings[0], name) is None:
                channels.pop(name, None)
        cuts = np.unique(np.concatenate(([0], np.flatnonzero(begins), [len(begins)])))
        for first, stop in zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True):
            part = slice(first, stop)
            recording = recording_of(self.file, channels, clock.values, self.sample_time, part)
            yield Chunk(recording, bool(begins[first]), row + first)

    def _wraps(self, name: str, channel: Channel) -> wraps.Wraps:
        """Wraps of an encoder, in the turn in which the head of the log begins."""
        first = getattr(self.head.recordings[0], name)
        turns = np.rint((first[0] - channel.values[0]) / wraps.TURN)
        return wraps.Wraps(self.file, name, channel.column, offset=wraps.TURN * float(turns))

    def finished(self, rows: int) -> list[str]:
        """Warnings about the whole."""
        if self.n_gaps > MOST_GAPS * rows:
            raise RecordingError(
                self.file,
                "",
                f"samples are missing in {self.n_gaps} places: record at a fixed rate",
            )
        warnings = [warning for one in self.wraps.values() for warning in one.warnings()]
        warnings += [warning for one in self.still.values() for warning in one.warnings()]
        if self.n_gaps:
            times = first_times(self.gaps, self.n_gaps)
            warnings.append(
                f"{self.file}: samples are missing from {times}, so the log was cut there into "
                f"recordings: record without gaps"
            )
        if self.steps:
            change = self.elapsed / self.steps / self.sample_time - 1.0
            if abs(change) > _DRIFT:
                warnings.append(
                    f"{self.file}: the sample time of the whole log differs by {change:.1e} from "
                    f"that of its beginning, which was used: check the clock"
                )
        return warnings

    def _begins(self, table: Table, column: str, time: FloatArray) -> NDArray[np.bool_]:
        """Whether a recording begins at each sample; raise unless time runs evenly in between."""
        steps = np.diff(time, prepend=self.last_time)
        if np.isnan(self.last_time):
            steps[0] = np.inf
        begins = steps > GAP * self.sample_time
        uneven = (np.abs(steps - self.sample_time) > 2.0 * EVEN * self.sample_time) & ~begins
        for is_bad in (~(steps > 0.0), uneven):
            if is_bad.any():
                index = int(np.argmax(is_bad))
                reason = self._bad_step(float(time[index]), float(steps[index]))
                raise RecordingError(self.file, table.place(index, column), reason)
        cuts = np.flatnonzero(begins & np.isfinite(steps))
        first = time[0] if np.isnan(self.last_time) else self.last_time
        self.elapsed += float(time[-1] - first - np.sum(steps[cuts]))
        self.steps += len(time) - int(np.count_nonzero(begins))
        self.n_gaps += len(cuts)
        self.gaps += [
            f"{time[index] - steps[index]:.6g} s to {time[index]:.6g} s"
            for index in cuts[:MOST_TIMES]
        ]
        self.last_time = float(time[-1])
        return begins

    def _bad_step(self, now: float, step: float) -> str:
        """What is wrong with a time, which comes so many s after the one before."""
        if not step > 0.0:
            return (
                f"time runs backwards or repeats (from {now - step:.9g} s to {now:.9g} s): sort "
                f"the rows, or cut the file there into two logs"
            )
        return (
            f"the time step is {1e3 * step:.6g} ms where the sample time is "
            f"{1e3 * self.sample_time:.6g} ms, and a stream is not interpolated: resample the log "
            f"to even times, or identify a shorter part of it without --stream"
        )

    def _watch(self, channels: dict[str, Channel], time: FloatArray) -> None:
        """Look for encoders that stand still while the other side moves."""
        if "link_position" not in channels:
            return
        sensors = ("deflection" if "deflection" in channels else "link_position", "motor_position")
        others = ("motor_position", "link_position")
        for name, other in zip(sensors, others, strict=True):
            if name not in self.still:
                moves = max(float(np.ptp(getattr(p, other))) for p in self.head.recordings)
                self.still[name] = Still(self.file, name, channels[name].column, 0.1 * moves)
            self.still[name].look(channels[name].values, channels[other].values, time)
