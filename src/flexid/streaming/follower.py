"""From a source to a session: bytes become lines, lines samples, and samples estimates."""

from collections.abc import Generator, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError, SettingError
from flexid.identification.result.identification import Identification
from flexid.recording import checks
from flexid.recording.channel import ENCODERS, INPUTS, Draft
from flexid.recording.recipes import MapSource
from flexid.recording.wraps import TURN
from flexid.streaming.checkpoint import ReadBefore, opened_session
from flexid.streaming.incoming import (
    HEAD_LINES,
    LINES_FOR_LAYOUT,
    Incoming,
    Replay,
    TextSamples,
    is_whole_log,
    sample_time_of,
)
from flexid.streaming.options import (
    StreamChannels,
    not_accounted_for,
    options_of_stream,
    wanted_kind,
)
from flexid.streaming.session import Session
from flexid.streaming.sources import open_source

_DURATION = 20.0  # s that are looked at
_FEWEST = 500  # samples of them
_MOST = 100_000


class Scales:
    """The first samples of a stream, until they are checked for sizes that no joint has.

    What two encoders contradict each other in, the health says.
    """

    def __init__(self, source: str, channels: StreamChannels, sample_time: float) -> None:
        self._source, self._channels = source, channels
        self._wanted = min(max(round(_DURATION / sample_time), _FEWEST), _MOST)
        self._parts: list[FloatArray] = []
        self._is_checked = False

    def take(self, samples: FloatArray) -> tuple[str, ...]:
        """What is wrong, a sentence each, as soon as enough samples have come."""
        if self._is_checked:
            return ()
        self._parts.append(samples[np.isfinite(samples).all(axis=1)])
        if sum(map(len, self._parts)) < self._wanted:
            return ()
        taken, self._is_checked, self._parts = np.concatenate(self._parts), True, []
        before = np.maximum.accumulate(np.concatenate(([-np.inf], taken[:-1, 0])))
        columns = taken[taken[:, 0] > before].T
        named = zip(self._channels.sampled.items(), columns, strict=True)
        log = Draft(self._source, {n: replace(one, values=own) for (n, one), own in named})
        try:
            for name in log.names:
                checks.check_whole(log, name)
            for name in log.those_of(ENCODERS):
                turn = self._channels.motor_turn if name == "motor_position" else 0.0
                if turn or log.joint == "revolute":
                    log[name] = np.unwrap(log[name], period=turn or TURN)
                checks.check_speed(log, name)
            for name in log.those_of(INPUTS):
                checks.check_power(log, name)
        except RecordingError as error:  # for which a log would be refused
            log.warnings.append(str(error))
        return tuple(log.warnings)


@dataclass(eq=False)
class Follower:
    """A stream that is followed."""

    source: str
    chosen: Mapping[str, Any]
    _: KW_ONLY
    estimate: Identification | None = None
    column_map: MapSource | None = None
    header: str | None = None
    checkpoint: Path | None = None
    stop_at_end: bool = False
    session: Session | None = None  # None until the stream's first lines have come
    warnings: tuple[str, ...] = ()
    _read_before: ReadBefore | None = None
    _scales: Scales | None = None

    def __post_init__(self) -> None:
        self._kind = wanted_kind(self.chosen, self.estimate)
        self._is_file = self.source != "-" and "://" not in self.source

    def _opened(self) -> Incoming:
        if is_whole_log(self.source):
            if self.header is not None:
                raise SettingError("header", "is for lines of text: leave it out for such a log")
            return Replay(Path(self.source), self.column_map, self._kind)
        source = open_source(self.source, stop_at_end=self.stop_at_end)
        known = self.chosen.get("sample_time") is not None
        fewest = LINES_FOR_LAYOUT if known else HEAD_LINES
        return TextSamples(
            source, self.column_map, model=self._kind, header=self.header, fewest=fewest
        )

    def turns(self, every: float) -> Generator[bool]:
        """Take in what comes, until the source ends."""
        incoming = self._opened()
        ended = False
        try:
            while not ended:
                samples = incoming.read()
                ended = samples is None
                self.warnings = tuple(dict.fromkeys(self.warnings + incoming.warnings))
                if self.session is None and samples is not None and len(samples):
                    self.session = self._begun(incoming, samples)
                    self._read_before = ReadBefore(self.session) if self._is_file else None
                if self.session is not None:
                    yield from self._take(self.session, samples, every)
                yield False
        finally:
            incoming.close()

    def _take(self, session: Session, samples: FloatArray | None, every: float) -> Iterator[bool]:
        """Feed the session with what it has not read before; stop wherever a report is due."""
        if samples is None:
            samples = np.empty((0, session.options.width))
        if self._read_before is not None:
            samples = self._read_before.new(samples)
        between = max(1, round(min(every / session.options.sample_time, 1e15)))
        done = 0
        while done < len(samples):
            part = samples[done : done + between - session.fed % between]
            session.feed(part)
            if self._scales is not None:
                self.warnings += self._scales.take(part)
            if self._read_before is not None:
                self._read_before.note(part)
            done += len(part)
            if session.fed % between == 0:
                yield True

    def _begun(self, incoming: Incoming, samples: FloatArray) -> Session:
        channels = incoming.channels
        assert channels is not None
        self.warnings = tuple(dict.fromkeys(self.warnings + channels.warnings))
        sample_time = self.chosen.get("sample_time")
        if sample_time is None:
            sample_time = sample_time_of(incoming.name, samples[:HEAD_LINES, 0])
        options = options_of_stream(self.chosen, self.estimate, channels, sample_time)
        self._scales = Scales(incoming.name, channels, sample_time)
        if self.estimate is not None:
            self.warnings += tuple(not_accounted_for(self.estimate, sample_time))
        return opened_session(options, self.checkpoint)
