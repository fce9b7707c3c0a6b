"""Result of `flexid.watch`: an estimator of a stream that is fed or followed."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexid.arrays import FloatArray
from flexid.errors import ArgumentError, RecordingError, SettingError
from flexid.estimators.excitation import Excitation
from flexid.identification.result import Identification
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.library.answer import Answer
from flexid.library.arguments import kind_of
from flexid.models.motion import JointType
from flexid.recording.recipes import MapSource
from flexid.recording.recording import Channel, Origin, si_units
from flexid.streaming.guard import Counts
from flexid.streaming.health import Health, Judgement
from flexid.streaming.incoming import (
    HEAD_LINES,
    LINES_FOR_LAYOUT,
    Replay,
    TextSamples,
    is_whole_log,
    sample_time_of,
)
from flexid.streaming.learner import Departure
from flexid.streaming.options import (
    StreamChannels,
    chosen_channels,
    not_accounted_for,
    options_of_stream,
    wanted_kind,
)
from flexid.streaming.session import Change, Session

_AT_ONCE = 64  # samples that are collected before they are processed together


class Watch(Answer):
    """Online estimate of a stream, returned by `flexid.watch`: feed it or iterate over it."""

    _report = "watch"
    _file = "watch.json"

    time: float
    """Time of the latest sample in s."""
    coefficients: Mapping[str, ValueEstimate]
    """Coefficients of the model by name, with intervals and verdicts."""
    parameters: Mapping[str, ValueEstimate]
    """Physical parameters by name, with intervals and verdicts."""
    excitation: Mapping[str, Excitation]
    """Excitation of each row by the samples used so far: (A4) of Huang (2003), measured."""
    counts: Counts
    """Numbers of samples that were used and excluded, by cause."""
    changes: tuple[Change, ...]
    """Detected changes of the drive, with their times."""
    departures: tuple[Departure, ...]
    """Departures from the estimate given as reference, the clearest first."""

    def __init__(
        self,
        source: str | None,  # None: samples are fed
        chosen: Mapping[str, Any],  # options by name; None and "auto": not chosen
        every: float = 1.0,  # s of the stream between reports
        *,
        estimate: Identification | None = None,  # reference for the drive
        column_map: MapSource | None = None,
        header: str | None = None,
        stop_at_end: bool = False,
    ) -> None:
        self._source, self._chosen, self._every = source, chosen, every
        self._estimate, self._column_map = estimate, column_map
        self._header, self._stop_at_end = header, stop_at_end
        self._kind = wanted_kind(chosen, estimate)
        self._session: Session | None = None  # made once its channels are known
        self._warnings: tuple[str, ...] = ()
        self._names: set[str] = set()  # names of the channels that are fed
        self._sampled: list[str] = []  # channels of a sample that are used, in order
        self._start = 0.0
        self._since_start = 0
        self._pending: list[FloatArray] = []

    @property
    def result(self) -> Session:
        """Session with all samples fed so far."""
        if self._session is None:
            raise ArgumentError("watch", "samples", "have not arrived yet: feed some first")
        self._catch_up(self._session)
        return self._session

    @property
    def has_begun(self) -> bool:
        """Whether samples have arrived."""
        return self._session is not None

    @property
    def has_converged(self) -> bool:
        """Whether the intervals of stiffness and inertias are narrow."""
        return self.health.health is Health.CONVERGED

    def turns(self) -> Generator[bool]:
        """Follow the source; yield after each read of it, with True whenever a report is due."""
        with closing(self._opened()) as incoming:
            for samples in incoming:
                self._warnings = tuple(dict.fromkeys(self._warnings + incoming.warnings))
                if self._session is None and len(samples):
                    assert incoming.channels is not None
                    sample_time = self._chosen.get("sample_time")
                    if sample_time is None:
                        sample_time = sample_time_of(incoming.name, samples[:HEAD_LINES, 0])
                    self._begin(incoming.channels, sample_time)
                if self._session is not None:
                    yield from _feed_until_due(self._session, samples, self._every)
                yield False

    def _opened(self) -> TextSamples | Replay:
        source, kind = self._source, self._kind
        if source is None:
            raise ArgumentError("watch", "source", "is missing: give one, or feed samples")
        if is_whole_log(source):
            if self._header is not None:
                raise SettingError("header", "is for lines of text: leave it out for such a log")
            return Replay(Path(source), self._column_map, kind)
        known = self._chosen.get("sample_time") is not None
        return TextSamples(
            source,
            self._column_map,
            stop_at_end=self._stop_at_end,
            model=kind,
            header=self._header,
            fewest=LINES_FOR_LAYOUT if known else HEAD_LINES,
        )

    def _begin(self, channels: StreamChannels, sample_time: float) -> Session:
        """Create the session of a stream with these channels."""
        options = options_of_stream(self._chosen, self._estimate, channels, sample_time)
        if self._estimate is not None:
            self._warnings += tuple(not_accounted_for(self._estimate, sample_time))
        self._session = Session(options)
        return self._session

    def _catch_up(self, session: Session) -> None:
        """Process pending samples together; one call per sample would take ten times as long."""
        if self._pending:
            samples = np.concatenate(self._pending)
            self._pending = []
            session.feed(samples)

    def feed(
        self,
        *,
        motor_position: ArrayLike,
        link_position: ArrayLike | None = None,
        deflection: ArrayLike | None = None,
        motor_torque: ArrayLike | None = None,
        motor_current: ArrayLike | None = None,
        motor_voltage: ArrayLike | None = None,
        time: ArrayLike | None = None,
    ) -> None:
        """Feed one sample or a block of samples; the size of the blocks does not change the result.

        Parameters
        ----------
        motor_position : float or array, shape (n,)
            In rad, at the link's side of the gear; in m for a prismatic joint.
        link_position, deflection : float or array, shape (n,), optional
            One of them, in the same unit; without either the joint is modelled as rigid.
        motor_torque, motor_current, motor_voltage : float or array, shape (n,)
            One of them, in N m or N, A or V; without any the link alone is estimated, driven by the
            motor's measured motion.
        time : float or array, shape (n,), optional
            In s; by default the samples are one sample time apart.
        """
        given = {
            "time": time,
            "link_position": link_position,
            "deflection": deflection,
            "motor_position": motor_position,
            "motor_torque": motor_torque,
            "motor_current": motor_current,
            "motor_voltage": motor_voltage,
        }
        arrays = {
            name: _as_samples(name, values) for name, values in given.items() if values is not None
        }
        lengths = {name: len(values) for name, values in arrays.items()}
        if len({*lengths.values()}) > 1:
            raise ArgumentError("feed", "samples", f"differ in number: {lengths}")
        names = {*arrays} - {"time"}
        session = self._session or self._begin_fed(arrays)
        if names != self._names:
            given, before = (", ".join(sorted(each)) for each in (names, self._names))
            raise ArgumentError(
                "feed", "channels", f"are {given}, and were {before}: give the same"
            )
        count, h = lengths["motor_position"], session.options.sample_time
        if time is None:
            steps = self._since_start + np.arange(count, dtype=np.float64)
            arrays["time"] = self._start + h * steps
            self._since_start += count
        elif count:
            self._start, self._since_start = float(arrays["time"][-1]) + h, 0
        self._pending.append(np.column_stack([arrays[name] for name in self._sampled]))
        if sum(map(len, self._pending)) >= _AT_ONCE:
            self._catch_up(session)

    def _begin_fed(self, arrays: Mapping[str, FloatArray]) -> Session:
        """Create the session of a fed stream from its first samples."""
        if self._source is not None:
            raise ArgumentError("feed", "samples", "come from the source: iterate over it instead")
        made = "revolute" if self._estimate is None else self._estimate.joint
        joint: JointType = self._chosen["joint_type"] or made
        channels = {}
        for name, values in {"time": arrays["motor_position"][:0], **arrays}.items():
            origin = Origin({name: 1.0}, 1.0, 0.0, si_units(name, joint)[0], None)
            channels[name] = Channel(values, name, True, origin)
        chosen = chosen_channels("feed", channels, (), self._kind)
        session = self._begin(chosen, self._chosen["sample_time"])
        self._names, self._sampled = {*arrays} - {"time"}, [*chosen.sampled]
        return session

    def __iter__(self) -> Iterator[Watch]:
        """Follow the source; yield every `every` seconds of the stream, and at its end."""
        error = None
        try:
            for due in self.turns():
                if due:
                    yield self
        except RecordingError as found:
            error = found
        if self.has_begun:
            yield self
        if error is not None:
            raise error

    @property
    def health(self) -> Judgement:
        """State of the estimation as a `Health`, with a sentence as the reason."""
        if not self.has_begun:
            return Judgement(Health.CONVERGING, "no sample has arrived so far")
        return self.result.health

    @property
    def warnings(self) -> tuple[str, ...]:
        """Assumptions on the source's columns, and effects that a stream neglects."""
        return self._warnings

    def __repr__(self) -> str:
        health = self.health
        return f"<Watch: {health.health.words}, {health.reason}>"


def _feed_until_due(session: Session, samples: FloatArray, every: float) -> Iterator[bool]:
    """Feed the session; yield True whenever a report is due."""
    between = max(1, round(min(every / session.options.sample_time, 1e15)))
    done = 0
    while done < len(samples):
        part = samples[done : done + between - session.fed % between]
        session.feed(part)
        done += len(part)
        if session.fed % between == 0:
            yield True


def _as_samples(name: str, values: Any) -> FloatArray:
    """Return a channel's numbers, shape (n,); raise `ArgumentError` for other values."""
    try:
        found = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError):
        raise ArgumentError("feed", name, f"is {kind_of(values)}: give numbers") from None
    if found.ndim != 1:
        raise ArgumentError("feed", name, f"has {found.ndim} dimensions: give one number a sample")
    return found
