"""From a source to a session: bytes become lines, lines samples, and samples estimates."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.recording.column_map import MapSource
from flexid.streaming.checkpoint import read_session
from flexid.streaming.options import WatchOptions
from flexid.streaming.session import Session
from flexid.streaming.sources import named, open_source
from flexid.streaming.text_stream import (
    HEAD_LINES,
    LineReader,
    StreamColumns,
    sample_time_of,
    stream_columns,
)

_FEWEST_WITH_SAMPLE_TIME = 8  # lines that are waited for where only the layout is sought


@dataclass(frozen=True)
class Choices:
    """What a user chooses; the rest follows from the stream.

    Parameters
    ----------
    terms, hold, filter_rate, memory, coulomb_velocity
        As of `WatchOptions`.
    sample_time : float or None
        In s; None takes it from the first time stamps.
    """

    terms: tuple[str, ...]
    hold: str
    filter_rate: float
    memory: float
    coulomb_velocity: float
    sample_time: float | None = None

    def options(
        self, kind: str, input_unit: str, sample_time: float, *, from_deflection: bool
    ) -> WatchOptions:
        """Options of a session."""
        return WatchOptions(
            sample_time,
            self.terms,
            kind,  # type: ignore[arg-type] - WatchOptions checks it
            self.hold,  # type: ignore[arg-type] - WatchOptions checks it
            self.filter_rate,
            self.memory,
            self.coulomb_velocity,
            input_unit,
            from_deflection,
        )


def opened_session(options: WatchOptions, checkpoint: Path | None) -> Session:
    """A session from a checkpoint, if there is one, or a new one.

    Raises
    ------
    SettingError
        If the checkpoint cannot be used, or was saved with other options.
    """
    if checkpoint is None or not checkpoint.exists():
        return Session(options)
    session = read_session(checkpoint)
    # What was measured from time stamps differs a little from one stream to the next.
    close = abs(session.options.sample_time / options.sample_time - 1.0) < 1e-3
    given = replace(options, sample_time=session.options.sample_time) if close else options
    if session.options != given:
        was, now = session.options.document, given.document
        names = ", ".join(f"{name} {was[name]!r}" for name in was if was[name] != now[name])
        raise SettingError(
            "checkpoint", f"{checkpoint} was saved with {names}: choose the same, or another file"
        )
    return session


def checked_every(every: float) -> float:
    """Seconds between two reports, if they are any; else a `SettingError`."""
    if not every > 0.0:
        raise SettingError("every", f"{every} is no time: give seconds above 0")
    return every


class Follower:
    """A stream that is followed.

    Parameters
    ----------
    source : str
        See `flexid.streaming.sources.open_source`.
    choices : Choices
        What the user chooses.
    column_map : path, mapping or None, optional
        A column map, as for logs.
    header : str, optional
        Names of the columns, where the stream does not begin with them.
    checkpoint : Path, optional
        To go on from, if it is there.
    stop_at_end : bool, optional
        Whether a file ends where it ends, or is waited for to grow.
    duration : float, optional
        Seconds on the wall's clock after which to stop.

    """

    def __init__(
        self,
        source: str,
        choices: Choices,
        *,
        column_map: MapSource | None = None,
        header: str | None = None,
        checkpoint: Path | None = None,
        stop_at_end: bool = False,
        duration: float | None = None,
    ) -> None:
        self.session: Session | None = None
        """None until the stream's first lines have come."""
        self.warnings: tuple[str, ...] = ()
        self._choices = choices
        self._map = column_map
        self._checkpoint = checkpoint
        self._duration = duration
        self._source = source
        self._stop_at_end = stop_at_end
        fewest = HEAD_LINES if choices.sample_time is None else _FEWEST_WITH_SAMPLE_TIME
        self._lines = LineReader(named(source), header, fewest)
        self._columns: StreamColumns | None = None

    def turns(self, every: float) -> Iterator[bool]:
        """Take in what comes, until the source ends.

        Parameters
        ----------
        every : float
            Seconds of the stream between two reports; see `checked_every`.

        Yields
        ------
        bool
            Whether a report is due; else it is a turn in which something came, or nothing.

        Raises
        ------
        RecordingError
            If the source cannot be opened, or the stream's first lines cannot be used.
        SettingError
            If the source is none, or the options do not suit it or the checkpoint.
        """
        source = open_source(self._source, stop_at_end=self._stop_at_end)
        begun = time.monotonic()
        ended = False
        try:
            while not ended:
                data = source.read()
                late = self._duration is not None and time.monotonic() - begun > self._duration
                ended = data is None or late
                cells = self._lines.cells(data or b"", ended=ended)
                if cells is not None and len(cells):
                    yield from self._take(cells, every)
                yield False
        finally:
            source.close()

    def _take(self, cells: FloatArray, every: float) -> Iterator[bool]:
        """Feed the session, and stop wherever a report is due."""
        samples = self._samples(cells)
        session = self.session = self.session or self._begun(samples)
        between = max(1, round(min(every / session.options.sample_time, 1e15)))
        done = 0
        while done < len(samples):
            part = samples[done : done + between - session.fed % between]
            session.feed(part)
            done += len(part)
            if session.fed % between == 0:
                yield True

    def _samples(self, cells: FloatArray) -> FloatArray:
        if self._columns is None:
            assert self._lines.layout is not None
            self._columns = stream_columns(self._lines.source, self._lines.layout, self._map)
            self.warnings = self._columns.warnings
        return self._columns.samples(cells)

    def _begun(self, samples: FloatArray) -> Session:
        columns, choices = self._columns, self._choices
        assert columns is not None
        sample_time = choices.sample_time or sample_time_of(self._lines.source, samples[:, 0])
        options = choices.options(
            columns.kind, columns.input_unit, sample_time, from_deflection=columns.from_deflection
        )
        return opened_session(options, self._checkpoint)
