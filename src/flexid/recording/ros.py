"""ROS bags and MCAP files: the numbers in their messages as signals named ``topic.field``."""

from __future__ import annotations

import hashlib
from collections import ChainMap
from collections.abc import Collection, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from flexid.errors import RecordingError
from flexid.files import shown
from flexid.recording.arrays import WIDEST
from flexid.recording.limits import MOST_COLUMNS
from flexid.recording.outside import DEEPEST, digest_of, need, readable
from flexid.recording.ros_messages import WHAT, bag_files, decoder, raw_messages
from flexid.recording.ros_values import (
    Found,
    Joint,
    Signal,
    Steps,
    Values,
    child,
    is_joint,
    path_of,
    stamp_of,
)
from flexid.recording.series import LONGEST_PATH, Series, SeriesFile

if TYPE_CHECKING:
    from pathlib import Path

_LOOKED_AT = 50  # messages of each topic, from which its fields are known
_JOINT_STATE = ("position", "velocity", "effort")
_UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N m"}  # of sensor_msgs/JointState


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
    found: dict[str, Found] = {}
    others: dict[str, str] = {}
    damage: RecordingError | None = None
    try:
        with readable(file, WHAT):
            _look_at(file, files, found, others)
    except RecordingError as error:  # what comes before can be played again
        if not any(topic.signals for topic in found.values()):
            raise
        damage = error
    series, signals = [], {}
    values = Values(file, files, found)
    for topic in found.values():
        for name, signal in topic.signals.items():
            signals[name] = signal
            unit = _UNITS[str(signal.steps[0])] if is_joint(signal.steps) else ""
            series.append(Series(name, "number", topic.count, signal.array, unit, signal.clock))

    def prepare(chosen: Collection[Series]) -> None:
        if damage is not None:
            raise damage
        with readable(file, WHAT):
            values.read([signals[one.path] for one in chosen])

    def parts(chosen: Collection[Series], size: int) -> Iterator[tuple[float, float]]:
        yield from values.parts([signals[one.path] for one in chosen], size)
        if damage is not None:
            raise damage

    unstamped = {
        name: f"{file}: the messages of {name!r} carry no time stamps, so the times at which they "
        f"were logged were taken: log a message with a header"
        for topic in found.values()
        if not topic.stamped
        for name in {signal.clock for signal in topic.signals.values()}
    }
    return SeriesFile(
        file,
        digest,
        tuple(series),
        others,
        {name: values.clock(name) for name in {one.clock for one in signals.values()}},
        ChainMap(values.late, unstamped),
        prepare,
        parts,
    )


def _look_at(file: str, files: list[Path], found: dict[str, Found], others: dict[str, str]) -> None:
    """Note topics and their fields, from their first messages, and what is no signal in them."""
    for topic, _, raw in raw_messages(file, files):
        known = found.get(topic.name)
        if known is None:
            decode, why = decoder(topic)
            known = found[topic.name] = Found(topic, decode)
            if decode is None:
                others[topic.name] = why
        known.count += 1
        if known.decode is None or known.count > _LOOKED_AT:
            continue
        message = known.decode(raw)
        if known.stamped is None:
            known.stamped = bool(stamp_of(message))
        for steps, value in _numbers(message):
            name = path_of(topic.name, steps)
            if isinstance(value, str):
                others[name] = value
            elif len(name) <= LONGEST_PATH:
                clock = f"{topic.name} of {steps[-1]}" if is_joint(steps) else topic.name
                known.signals.setdefault(name, Signal(topic.name, steps, clock))
        if sum(len(one.signals) for one in found.values()) > MOST_COLUMNS:
            raise RecordingError(
                file, "", "its messages hold too many numbers: log the topics of one joint"
            )


def _fields(message: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(message, dict):
        yield from ((str(name), value) for name, value in message.items())
    else:
        for name in getattr(message, "__dataclass_fields__", ()):
            yield name, getattr(message, name)


def _numbers(message: Any) -> Iterator[tuple[Steps, float | str]]:
    """Every number of a message with the steps that lead to it, and texts on what is no number."""
    names = child(message, "name")
    if all(child(message, key) is not None for key in _JOINT_STATE) and isinstance(names, list):
        for key in _JOINT_STATE:
            values = child(message, key)
            for name, value in zip(names, values, strict=False):
                yield (key, Joint(name)), float(value)
        return
    for name, value in _fields(message):
        if name not in ("header", "structure_needs_at_least_one_member"):
            yield from _within(value, (name,))


def _within(value: Any, steps: Steps) -> Iterator[tuple[Steps, float | str]]:
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
