"""Values and times of chosen signals, from the messages of a bag or an MCAP file."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.limits import MOST_ROWS
from flexid.recording.one_clock import AROUND, values_around
from flexid.recording.outside import readable
from flexid.recording.ros_messages import WHAT, Topic, raw_messages

if TYPE_CHECKING:
    from pathlib import Path

    from flexid.arrays import FloatArray
    from flexid.recording.ros_messages import Decode

_MOST_PARTS = 4  # times as many values are read as a part has, for a clock that has too few


class Joint(str):
    """The name of a joint, in place of its index, which may differ from message to message."""

    __slots__ = ()


Steps = tuple[str | int | Joint, ...]


@dataclass
class Signal:
    """Where a signal stands in a topic's messages, and its values once they are read."""

    topic: str
    steps: Steps
    clock: str
    values: list[float] = field(default_factory=list)

    def array(self) -> FloatArray:
        """Its values."""
        return np.array(self.values, dtype=np.float64)


@dataclass
class Found:
    """What is known of a topic."""

    topic: Topic
    decode: Decode | None
    count: int = 0
    stamped: bool | None = None
    signals: dict[str, Signal] = field(default_factory=dict)


@dataclass(eq=False)
class _Reading:
    """Messages of some topics that are read on together.

    Parameters
    ----------
    topics : set of str
        Those of others are passed over.
    added : iterator of str
        Adds the values of one message after the other, and says whose clocks they came by.
    parts : int, optional
        For how many parts values are read, until each clock has enough for one.
    ended : bool, optional
        Whether nothing more comes.
    """

    topics: set[str]
    added: Iterator[str]
    parts: int = 1
    ended: bool = False

    @property
    def is_paused(self) -> bool:
        """Whether so much has been read that a clock without values must have paused."""
        return self.parts > _MOST_PARTS


class Values:
    """Values of chosen signals of a file, and the times at which they were.

    Parameters
    ----------
    file : str
        For messages.
    files : list of Path
        Of one bag.
    found : mapping of str to Found
        Its topics, by name.
    """

    def __init__(self, file: str, files: list[Path], found: dict[str, Found]) -> None:
        self.late: dict[str, str] = {}
        """By clock, what to say of messages that came too late for their part."""
        self._file, self._files, self._found = file, files, found
        self._chosen: list[Signal] = []
        self._by_topic: dict[str, list[Signal]] = {}  # that are chosen
        self._added: dict[str, int] = {}  # by topic, how many messages have been read
        self._stamps: dict[str, list[int]] = {}  # by clock, in ns
        self._origin = 0  # ns
        self._done = -inf  # ns up to which parts have been read
        self._left: dict[str, int] = {}  # by clock, how many messages are kept no more

    def clock(self, name: str) -> Callable[[], FloatArray]:
        """Time stamps in s, from the first of all signals that are read."""
        return lambda: np.array([self._seconds(time) for time in self._stamps[name]])

    def _seconds(self, time: float) -> float:
        return 1e-9 * (time - self._origin)

    def read(self, chosen: list[Signal]) -> None:
        """Read all values, in the order of their times.

        Raises
        ------
        RecordingError
            If there are too many, or one is missing in a message.
        """
        for clock in self._begun(chosen).added:
            if len(self._stamps[clock]) > MOST_ROWS:
                raise RecordingError(
                    self._file,
                    f"{clock!r}",
                    f"it has more than {MOST_ROWS} messages, the most that are read: log for a "
                    f"shorter time",
                )
        self._begin()

    def parts(self, chosen: list[Signal], size: int) -> Iterator[tuple[float, float]]:
        """Read one part after the other, see `SeriesFile`.

        Topics are read on together; one whose messages stand far behind those of the others is
        read apart from then on, ahead in the file.

        Raises
        ------
        RecordingError
            If a value is missing in a message, or the file is damaged, after the parts before.
        """
        readings, damage = [self._begun(chosen)], None
        ended, any_read = False, False
        while not ended:
            for reading in readings:
                damage = self._read_on(reading, size) or damage
            ended = all(reading.ended for reading in readings)
            if any_read:
                self._sort()
            else:
                self._begin()
            if self._has_to_wait(readings, size):
                continue
            end = min(self._end(reading, size) for reading in readings)
            if self._is_together() or (not (any_read or damage) and ended):
                any_read = True
                yield self._seconds(self._done), self._seconds(end)
            self._done = max(self._done, end)
            self._drop(size)
            for reading in readings:
                reading.parts = 1
        if damage is not None:
            raise damage

    def _read_on(self, reading: _Reading, size: int) -> RecordingError | None:
        """Read until a clock has values of some parts and those around; return what was wrong."""
        around = self._around(size)
        most = {
            name: bisect_right(times, self._done) + reading.parts * size + around[name]
            for name, times in self._stamps.items()
        }
        if reading.ended or any(len(self._stamps[n]) >= most[n] for n in self._clocks(reading)):
            return None
        try:
            with readable(self._file, WHAT):
                reading.ended = all(len(self._stamps[name]) < most[name] for name in reading.added)
        except RecordingError as error:
            reading.ended = True
            return self._said(error)
        return None

    def _has_to_wait(self, readings: list[_Reading], size: int) -> bool:
        """Whether more has to be read for the next part; then see to it that it will be."""
        late = [one for one in readings if self._end(one, size) <= self._done and not one.is_paused]
        for reading in late:
            reading.parts += 1
            if not reading.is_paused:
                continue
            behind = [t for t in reading.topics if self._end_of(t, size, most=True) <= self._done]
            if len(behind) < len(reading.topics):
                reading.topics -= {*behind}
                readings += [self._reading({topic}) for topic in behind]
                reading.parts = 1 if behind else reading.parts
        return bool(late)

    def _said(self, error: RecordingError) -> RecordingError:
        """Name the place at which a library failed; what we found wrong names its own."""
        read = max(self._left.get(name, 0) + len(times) for name, times in self._stamps.items())
        if error.__cause__ is None or not read:
            return error
        return RecordingError(
            self._file,
            f"message {read + 1} or after",
            "the file cannot be read on from there: export or copy it again",
        )

    def _begin(self) -> None:
        self._sort()
        self._origin = min((times[0] for times in self._stamps.values() if times), default=0)

    def _around(self, size: int) -> dict[str, int]:
        """How many values belong to a part beside its own, for each clock by its rate."""
        return {name: min(size, count) for name, count in values_around(self._stamps).items()}

    def _end(self, reading: _Reading, size: int) -> float:
        """The time up to which there is all that is needed, of clocks that have not paused."""
        if reading.ended:
            return inf
        return min(self._end_of(topic, size, most=reading.is_paused) for topic in reading.topics)

    def _end_of(self, topic: str, size: int, *, most: bool) -> float:
        """The same of a topic; with `most`, of the one of its clocks that has the most."""
        around = self._around(size)
        ends = [
            self._stamps[name][-around[name] - 1]
            if len(self._stamps[name]) > around[name]
            else -inf
            for name in {signal.clock for signal in self._by_topic[topic]}
        ]
        return max(ends) if most else min(ends)

    def _clocks(self, reading: _Reading) -> set[str]:
        return {signal.clock for topic in reading.topics for signal in self._by_topic[topic]}

    def _is_together(self) -> bool:
        """Whether the clocks have some time in common."""
        clocks = self._stamps.values()
        return min(map(len, clocks)) > 1 and max(t[0] for t in clocks) < min(t[-1] for t in clocks)

    def _drop(self, size: int) -> None:
        """Keep what the next part needs."""
        first = {
            name: max(0, bisect_right(self._stamps[name], self._done) - count)
            for name, count in self._around(size).items()
        }
        for signal in self._chosen:
            del signal.values[: first[signal.clock]]
        for name, count in first.items():
            del self._stamps[name][:count]
            self._left[name] = self._left.get(name, 0) + count

    def _begun(self, chosen: list[Signal]) -> _Reading:
        """Forget what was read; all topics are read together."""
        self._chosen = chosen
        self._stamps = {signal.clock: [] for signal in chosen}
        self._by_topic = {}
        for signal in chosen:
            signal.values.clear()
            self._by_topic.setdefault(signal.topic, []).append(signal)
        self._added = dict.fromkeys(self._by_topic, 0)
        return self._reading({*self._by_topic})

    def _reading(self, topics: set[str]) -> _Reading:
        """Read topics on from where they are."""
        before = {topic: self._added[topic] for topic in topics}
        return _Reading(topics, self._add_all(topics, before))

    def _add_all(self, topics: set[str], before: dict[str, int]) -> Iterator[str]:
        """Add the values of one message after the other; whose clocks they came by."""
        for topic, logged, raw in raw_messages(self._file, self._files, {*topics}):
            known = self._found[topic.name]
            if known.decode is None or topic.name not in topics:  # it is read apart
                continue
            if before[topic.name]:
                before[topic.name] -= 1
                continue
            self._added[topic.name] += 1
            message = known.decode(raw)
            time = stamp_of(message) if known.stamped else logged
            yield from self._add(message, time, self._by_topic[topic.name])

    def _add(self, message: Any, time: int, signals: list[Signal]) -> set[str]:
        """Add the values of a message; return their clocks."""
        values = [(signal, _at(message, signal.steps)) for signal in signals]
        for signal, value in values:
            if value is None and not _may_lack(message, signal.steps):
                number = self._left.get(signal.clock, 0) + len(signal.values) + 1
                raise RecordingError(
                    self._file,
                    f"message {number} of {signal.topic!r}",
                    f"it has no {path_of(signal.topic, signal.steps)!r}: log it always",
                )
        for signal, value in values:
            if value is not None:
                signal.values.append(value)
        seen = {signal.clock for signal, value in values if value is not None}
        for clock in seen:
            self._stamps[clock].append(time)
        if time <= self._done:
            for clock in seen:
                self.late[clock] = (
                    f"{self._file}: messages of {clock!r} that stand behind {AROUND} later ones "
                    f"are left out: sort the file by time"
                )
        return seen

    def _sort(self) -> None:
        """Bring messages that overtook each other into the order of their times."""
        for signal in self._chosen:
            times = self._stamps[signal.clock]
            order = sorted(range(len(times)), key=times.__getitem__)
            signal.values[:] = [signal.values[index] for index in order]
        for times in self._stamps.values():
            times.sort()


def stamp_of(message: Any) -> int:
    """Nanoseconds in a message's header; zero where it has none."""
    stamp = child(child(message, "header"), "stamp")
    seconds = child(stamp, "sec")
    parts = (child(stamp, name) for name in ("nanosec", "nsec", "nsecs"))
    rest = next((part for part in parts if part is not None), 0)
    return int(seconds) * 1_000_000_000 + int(rest) if isinstance(seconds, int) else 0


def child(message: Any, name: str) -> Any:
    """What a message has by a name; None where it has nothing."""
    if isinstance(message, dict):
        return message.get(name)
    return getattr(message, name, None)


def _at(message: Any, steps: Steps) -> float | None:
    """The number to which steps lead; None where there is none."""
    value = message
    for step in steps:
        if isinstance(step, Joint):
            names = child(message, "name")
            step = names.index(step) if step in names else len(value)
        if isinstance(step, int):
            if not isinstance(value, list | np.ndarray) or step >= len(value):
                return None
            value = value[step]
        else:
            value = child(value, step)
    return float(value) if isinstance(value, int | float | np.integer | np.floating) else None


def _may_lack(message: Any, steps: Steps) -> bool:
    """Whether a message is of other joints than the one to which steps lead."""
    return is_joint(steps) and steps[-1] not in (child(message, "name") or ())


def is_joint(steps: Steps) -> bool:
    """Whether they lead to a joint by its name."""
    return isinstance(steps[-1], Joint)


def path_of(topic: str, steps: Steps) -> str:
    """The steps as one writes them."""
    return topic + "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)
