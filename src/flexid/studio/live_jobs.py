"""Streams that are watched for windows, in one process that keeps them from piece to piece.

The process does a piece of half a second when it is asked to, so that whoever pauses or goes away
leaves it idle, and what is done to the simulated drive works from the next piece on.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from flexid.report.live_chart import Moment, live_chart
from flexid.streaming.health import Health
from flexid.studio.jobs import Row, row_of
from flexid.studio.live_choices import DRIVE, REPLAY
from flexid.studio.workers import JobError

if TYPE_CHECKING:
    from flexid.identification.vocabulary.progress import Progress
    from flexid.streaming.follower import Follower
    from flexid.streaming.session import Session
    from flexid.studio.choices import Choices
    from flexid.studio.live_choices import LiveChoices
    from flexid.studio.live_drive import SimulatedDrive

MOST_STREAMS = 8
MOST_MOMENTS = 240
"""Moments of a stream that are kept: beyond it every second one is forgotten."""

_TONES = {
    Health.CONVERGING: "fair",
    Health.CONVERGED: "good",
    Health.NOT_EXCITED: "fair",
    Health.INCONSISTENT: "bad",
    Health.SENSOR_FAULT: "bad",
}
_MOST_READS = 32  # pieces of a file that grows, in a turn


@dataclass(frozen=True)
class Seen:
    """What is known of a stream.

    Parameters
    ----------
    time : float
        Of the latest sample, in s.
    ended : bool
        Whether no more will come.
    health, tone, reason : str
        How the estimation is: words, a sign, a sentence.
    rows : tuple of Row
        The parameters.
    truth : mapping of str to str
        Their true values, where the drive is simulated.
    conditions : mapping of str to str
        Condition number by row.
    samples : str
        What became of the samples.
    remarks : tuple of str
        Changes of the drive and warnings.
    chart : dict
        Estimates over time, as a document.
    """

    time: float
    ended: bool
    health: str
    tone: str
    reason: str
    rows: tuple[Row, ...]
    truth: Mapping[str, str]
    conditions: Mapping[str, str]
    samples: str
    remarks: tuple[str, ...]
    chart: dict[str, Any]


class _Driven:
    """The simulated drive, and what is learnt of it."""

    def __init__(self) -> None:
        from flexid.streaming.session import Session
        from flexid.studio.live_drive import OPTIONS, SimulatedDrive

        self._drive: SimulatedDrive = SimulatedDrive()
        self.session: Session | None = Session(OPTIONS)
        self.warnings: tuple[str, ...] = ()
        self.truth: dict[str, float] = {}

    def go_on(self, choices: LiveChoices, moments: list[Moment]) -> bool:
        """Take in as many pieces as the pace asks for; it never ends."""
        from flexid.studio.live_drive import truth

        assert self.session is not None
        for _ in range(choices.pace):
            acts = {"loaded": choices.loaded, "unplugged": choices.unplugged}
            self.session.feed(self._drive.piece(**acts))
            keep(moments, self.session)
        self.truth = truth(loaded=choices.loaded)
        return True

    def close(self) -> None:
        """Nothing to give back."""


class _Logged:
    """A log that is played again, or followed while it grows."""

    def __init__(self, name: str, source: str, choices: Choices) -> None:
        from flexid.streaming.follower import Follower
        from flexid.studio.live_drive import PIECE

        self._replayed = source == REPLAY
        self._follower: Follower = Follower(
            name,
            {"terms": choices.terms, "hold": choices.hold, "kind": choices.model},
            column_map=choices.column_map,
            stop_at_end=self._replayed,
        )
        self._turns: Generator[bool] = self._follower.turns(PIECE)
        self.truth: dict[str, float] = {}

    @property
    def session(self) -> Session | None:
        """None until the first samples have come."""
        return self._follower.session

    @property
    def warnings(self) -> tuple[str, ...]:
        """What was assumed of the columns."""
        return self._follower.warnings

    def go_on(self, choices: LiveChoices, moments: list[Moment]) -> bool:
        """Take in some pieces, or what has come; return whether there may be more."""
        pieces = choices.pace if self._replayed else _MOST_READS
        for due in self._turns:
            if not (due or self._replayed):
                return True  # all that has come
            if due and self.session is not None:
                keep(moments, self.session)
            pieces -= due
            if not pieces:
                return True
        return False

    def close(self) -> None:
        """Close the file."""
        self._turns.close()


_STREAMS: dict[str, tuple[_Driven | _Logged, list[Moment]]] = {}
"""Streams by window, each with what was known so far."""


def begin(_: Progress, key: str, source: str, log: str, choices: Choices) -> None:
    """Begin a stream of a window, in place of the one that it has.

    Parameters
    ----------
    key : str
        Of the window.
    source : str
        Where samples come from.
    log : str
        Its name in the working directory, if they come from a log.
    choices : Choices
        Its columns, model, terms and hold, as in Identify.

    Raises
    ------
    JobError
        If there are as many as there may be.
    """
    forget(_, key)
    if len(_STREAMS) >= MOST_STREAMS:
        raise JobError(
            f"{MOST_STREAMS} streams run in other windows, the most there may be: stop one of them"
        )
    _STREAMS[key] = (_Driven() if source == DRIVE else _Logged(log, source, choices)), []


def forget(_: Progress, key: str) -> None:
    """End a stream, if it is there."""
    stream, _moments = _STREAMS.pop(key, (None, []))
    if stream is not None:
        stream.close()


def go_on(_: Progress, key: str, choices: LiveChoices) -> Seen | None:
    """Take in the next piece of a stream; return what is known, None if nothing has come so far.

    Raises
    ------
    JobError
        If the stream is lost.
    RecordingError, SettingError
        If the log cannot be watched.
    """
    if key not in _STREAMS:
        raise JobError("the stream is lost, since its process ended: start it again")
    stream, moments = _STREAMS[key]
    try:
        more = stream.go_on(choices, moments)
    except Exception:
        forget(_, key)
        raise
    if stream.session is None:
        if more:
            return None
        raise JobError("the log ends before its first samples: give one with samples")
    keep(moments, stream.session)
    return _seen(stream, stream.session, moments, ended=not more)


def keep(moments: list[Moment], session: Session) -> None:
    """Add what is known to a history that stays short: of too many, every second is forgotten."""
    if moments and not session.time > moments[-1].time:
        return
    values = {name: (p.value, *p.interval) for name, p in session.parameters.items()}
    conditions = {row: found.condition_number for row, found in session.excitation.items()}
    moments.append(Moment(session.time, values, conditions))
    if len(moments) > MOST_MOMENTS:
        del moments[1:-1:2]


def _seen(
    stream: _Driven | _Logged, session: Session, moments: list[Moment], *, ended: bool
) -> Seen:
    from flexid.report.charts.document import chart_document

    health, parameters = session.health, session.parameters
    units = {name: found.unit for name, found in parameters.items()}
    excitation = session.excitation.items()
    changes = [f"{change.sentence}." for change in session.changes[-3:]]
    return Seen(
        session.time,
        ended,
        health.health.words,
        _TONES[health.health],
        health.reason,
        tuple(map(row_of, parameters.values())),
        {name: f"{value:.4g}" for name, value in stream.truth.items()},
        {row: f"{found.condition_number:.3g}" for row, found in excitation},
        session.counts.sentence,
        (*changes, *stream.warnings),
        chart_document(live_chart(moments, units, stream.truth or None)),
    )
