"""From a source to a session: bytes become lines, lines samples, and samples estimates."""

from collections.abc import Generator, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path
from typing import Any

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.identification.result import Identification
from flexid.recording.recipes import MapSource
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
    not_accounted_for,
    options_of_stream,
    wanted_kind,
)
from flexid.streaming.session import Session
from flexid.streaming.sources import open_source


@dataclass(eq=False)
class Follower:
    """A stream that is followed."""

    source: str
    chosen: Mapping[str, Any]
    _: KW_ONLY
    estimate: Identification | None = None
    column_map: MapSource | None = None
    header: str | None = None
    stop_at_end: bool = False
    session: Session | None = None  # None until the stream's first lines have come
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self._kind = wanted_kind(self.chosen, self.estimate)

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
                if self.session is not None and samples is not None:
                    yield from _take(self.session, samples, every)
                yield False
        finally:
            incoming.close()

    def _begun(self, incoming: Incoming, samples: FloatArray) -> Session:
        channels = incoming.channels
        assert channels is not None
        self.warnings = tuple(dict.fromkeys(self.warnings + channels.warnings))
        sample_time = self.chosen.get("sample_time")
        if sample_time is None:
            sample_time = sample_time_of(incoming.name, samples[:HEAD_LINES, 0])
        options = options_of_stream(self.chosen, self.estimate, channels, sample_time)
        if self.estimate is not None:
            self.warnings += tuple(not_accounted_for(self.estimate, sample_time))
        return Session(options)


def _take(session: Session, samples: FloatArray, every: float) -> Iterator[bool]:
    """Feed the session; stop wherever a report is due."""
    between = max(1, round(min(every / session.options.sample_time, 1e15)))
    done = 0
    while done < len(samples):
        part = samples[done : done + between - session.fed % between]
        session.feed(part)
        done += len(part)
        if session.fed % between == 0:
            yield True
