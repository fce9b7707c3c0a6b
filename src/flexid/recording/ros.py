"""ROS bags and MCAP files: the numbers in their messages as signals named ``topic.field``."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.errors import RecordingError
from flexid.files import shown
from flexid.recording.arrays import WIDEST
from flexid.recording.limits import MOST_COLUMNS, MOST_ROWS
from flexid.recording.outside import DEEPEST, digest_of, need, readable
from flexid.recording.ros_messages import WHAT, Topic, bag_files, decoder, raw_messages
from flexid.recording.series import LONGEST_PATH, Series, SeriesFile

if TYPE_CHECKING:
    from pathlib import Path

    from flexid.arrays import FloatArray
    from flexid.recording.ros_messages import Decode

_LOOKED_AT = 50  # messages of each topic, from which its fields are known
_JOINT_STATE = ("position", "velocity", "effort")
_UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N m"}  # of sensor_msgs/JointState


class _Joint(str):
    """The name of a joint, in place of its index, which may differ from message to message."""

    __slots__ = ()


_Steps = tuple[str | int | _Joint, ...]


@dataclass
class _Signal:
    """Where a signal stands in a topic's messages, and its values once they are read."""

    topic: str
    steps: _Steps
    clock: str
    values: list[float] = field(default_factory=list)


@dataclass
class _Found:
    """What is known of a topic."""

    topic: Topic
    decode: Decode | None
    count: int = 0
    stamped: bool | None = None
    signals: dict[str, _Signal] = field(default_factory=dict)


def open_series(path: Path) -> SeriesFile:
    """The signals of an MCAP file, a ROS 1 bag, or a ROS 2 bag, which may be a folder.

    A `sensor_msgs/JointState` has its joints by name: ``/joint_states.position.elbow``. Each topic
    has a clock of its own: the stamps in the headers of its messages, or where they have none, the
    times at which they were logged.

    Raises
    ------
    RecordingError
        If it is no such file, a damaged one, or its packages are not installed.
    """
    file = shown(path)
    need(file, "mcap", "ros")
    need(file, "rosbags", "ros")
    files = bag_files(path)
    digests = [digest_of(one) for one in files]
    digest = (
        digests[0] if len(files) == 1 else hashlib.sha256("".join(digests).encode()).hexdigest()
    )
    with readable(file, WHAT):
        found, others = _looked_at(file, files)
    series, signals = [], {}
    for topic in found.values():
        for name, signal in topic.signals.items():
            signals[name] = signal
            unit = _UNITS[str(signal.steps[0])] if _is_joint(signal.steps) else ""
            series.append(Series(name, "number", topic.count, _values(signal), unit, signal.clock))
    stamps: dict[str, list[int]] = {}

    def prepare(chosen: Collection[Series]) -> None:
        with readable(file, WHAT):
            _read(file, files, found, [signals[one.path] for one in chosen], stamps)

    return SeriesFile(
        file,
        digest,
        tuple(series),
        others,
        {signal.clock: _clock(stamps, signal.clock) for signal in signals.values()},
        {
            name: f"{file}: the messages of {name!r} carry no time stamps, so the times at which "
            f"they were logged were taken: log a message with a header"
            for topic in found.values()
            if not topic.stamped
            for name in {signal.clock for signal in topic.signals.values()}
        },
        prepare,
    )


def _values(signal: _Signal) -> Callable[[], FloatArray]:
    return lambda: np.array(signal.values, dtype=np.float64)


def _clock(stamps: dict[str, list[int]], name: str) -> Callable[[], FloatArray]:
    """Time stamps in s, from the first of all signals that are read."""

    def seconds() -> FloatArray:
        begin = min(first for times in stamps.values() for first in times[:1])
        return 1e-9 * np.array([time - begin for time in stamps[name]], dtype=np.float64)

    return seconds


def _looked_at(file: str, files: list[Path]) -> tuple[dict[str, _Found], dict[str, str]]:
    """Topics and their fields, from their first messages, and what is no signal in them."""
    found: dict[str, _Found] = {}
    others: dict[str, str] = {}
    for topic, _, raw in raw_messages(file, files):
        known = found.get(topic.name)
        if known is None:
            decode, why = decoder(topic)
            known = found[topic.name] = _Found(topic, decode)
            if decode is None:
                others[topic.name] = why
        known.count += 1
        if known.decode is None or known.count > _LOOKED_AT:
            continue
        message = known.decode(raw)
        if known.stamped is None:
            known.stamped = bool(_stamp(message))
        for steps, value in _numbers(message):
            name = _path(topic.name, steps)
            if isinstance(value, str):
                others[name] = value
            elif len(name) <= LONGEST_PATH:
                clock = f"{topic.name} of {steps[-1]}" if _is_joint(steps) else topic.name
                known.signals.setdefault(name, _Signal(topic.name, steps, clock))
        if sum(len(one.signals) for one in found.values()) > MOST_COLUMNS:
            raise RecordingError(
                file, "", "its messages hold too many numbers: log the topics of one joint"
            )
    return found, others


def _read(
    file: str,
    files: list[Path],
    found: dict[str, _Found],
    chosen: list[_Signal],
    stamps: dict[str, list[int]],
) -> None:
    """Read the values and times of the chosen signals, in the order of their times."""
    stamps.clear()
    by_topic: dict[str, list[_Signal]] = {}
    for signal in chosen:
        signal.values.clear()
        by_topic.setdefault(signal.topic, []).append(signal)
    for topic, logged, raw in raw_messages(file, files, set(by_topic)):
        known = found[topic.name]
        if known.decode is None:
            continue
        message = known.decode(raw)
        time = _stamp(message) if known.stamped else logged
        seen = set()
        for signal in by_topic[topic.name]:
            value = _at(message, signal.steps)
            if value is None and not _may_lack(message, signal.steps):
                name, number = _path(topic.name, signal.steps), len(signal.values) + 1
                raise RecordingError(
                    file,
                    f"message {number} of {topic.name!r}",
                    f"it has no {name!r}: log it always",
                )
            if value is None:
                continue
            signal.values.append(value)
            if signal.clock not in seen:
                seen.add(signal.clock)
                stamps.setdefault(signal.clock, []).append(time)
                if len(stamps[signal.clock]) > MOST_ROWS:
                    raise RecordingError(
                        file,
                        f"{topic.name!r}",
                        f"it has more than {MOST_ROWS} messages, the most that are read: log for "
                        f"a shorter time",
                    )
    _sort(chosen, stamps)


def _sort(chosen: list[_Signal], stamps: dict[str, list[int]]) -> None:
    """Bring messages that overtook each other into the order of their times."""
    for signal in chosen:
        times = stamps.setdefault(signal.clock, [])
        order = sorted(range(len(times)), key=times.__getitem__)
        signal.values[:] = [signal.values[index] for index in order]
    for times in stamps.values():
        times.sort()


def _stamp(message: Any) -> int:
    """Nanoseconds in a message's header; zero where it has none."""
    stamp = _child(_child(message, "header"), "stamp")
    seconds = _child(stamp, "sec")
    parts = (_child(stamp, name) for name in ("nanosec", "nsec", "nsecs"))
    rest = next((part for part in parts if part is not None), 0)
    return int(seconds) * 1_000_000_000 + int(rest) if isinstance(seconds, int) else 0


def _child(message: Any, name: str) -> Any:
    if isinstance(message, dict):
        return message.get(name)
    return getattr(message, name, None)


def _fields(message: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(message, dict):
        yield from ((str(name), value) for name, value in message.items())
    else:
        for name in getattr(message, "__dataclass_fields__", ()):
            yield name, getattr(message, name)


def _numbers(message: Any) -> Iterator[tuple[_Steps, float | str]]:
    """Every number of a message with the steps that lead to it, and texts on what is no number."""
    names = _child(message, "name")
    if all(_child(message, key) is not None for key in _JOINT_STATE) and isinstance(names, list):
        for key in _JOINT_STATE:
            values = _child(message, key)
            for name, value in zip(names, values, strict=False):
                yield (key, _Joint(name)), float(value)
        return
    for name, value in _fields(message):
        if name not in ("header", "structure_needs_at_least_one_member"):
            yield from _within(value, (name,))


def _within(value: Any, steps: _Steps) -> Iterator[tuple[_Steps, float | str]]:
    if isinstance(value, bool | np.bool_) or value is None or len(steps) > DEEPEST:
        return
    if isinstance(value, int | float | np.integer | np.floating):
        yield steps, float(value)
    elif isinstance(value, str):
        yield steps, "text"
    elif isinstance(value, list | np.ndarray):
        if len(value) > WIDEST:
            yield steps, f"{len(value)} values in each message"
            return
        for index, one in enumerate(value):
            yield from _within(one, (*steps, index))
    else:
        for name, one in _fields(value):
            yield from _within(one, (*steps, name))


def _at(message: Any, steps: _Steps) -> float | None:
    """The number to which steps lead; None where there is none."""
    value = message
    for step in steps:
        if isinstance(step, _Joint):
            names = _child(message, "name")
            step = names.index(step) if step in names else len(value)
        if isinstance(step, int):
            if not isinstance(value, list | np.ndarray) or step >= len(value):
                return None
            value = value[step]
        else:
            value = _child(value, step)
    return float(value) if isinstance(value, int | float | np.integer | np.floating) else None


def _may_lack(message: Any, steps: _Steps) -> bool:
    """Whether a message is of other joints than the one to which steps lead."""
    return _is_joint(steps) and steps[-1] not in (_child(message, "name") or ())


def _is_joint(steps: _Steps) -> bool:
    return isinstance(steps[-1], _Joint)


def _path(topic: str, steps: _Steps) -> str:
    return topic + "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps)
