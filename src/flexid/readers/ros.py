"""Reader of ROS bags and MCAP files: numbers in messages become signals ``topic.field``.

MCAP files are opened by mcap, bags by rosbags. ROS messages of both are decoded by rosbags.
"""

import json
import re
from array import array
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from flexid.readers.formats import STAMPS, WIDEST, Contents, Frame, RefusedError, Series, files_of

_LARGEST_RECORD = 1_000_000_000  # bytes
_LONGEST_DEFINITION = 200_000  # characters
_SCANNED = 50  # messages of each topic that are searched for fields
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*){1,3}")
_JOINT_STATE = {"position": "rad", "velocity": "rad/s", "effort": "N m"}  # with units of ROS


class Topic(NamedTuple):
    """A topic and the encoding of its messages."""

    name: str
    kind: str  # name of the message type
    encoding: str  # cdr, ros1 or json; messages in others are not read
    definition: str  # of the type; empty if the file has none
    language: str  # of the definition: ros1msg, ros2msg or ros2idl


class _Signal(NamedTuple):
    """A signal: a number in the messages of a topic."""

    unit: str
    clock: str
    joint: str  # name of its joint in a `JointState`; else empty


@dataclass
class _TopicContents:
    """Scanned contents of a topic."""

    decode: Callable[[bytes], Any] | None
    count: int = 0
    stamped: bool | None = None
    signals: dict[str, _Signal] = field(default_factory=dict)


def read(path: Path) -> Contents:
    """Return the signals of an MCAP file, a ROS 1 bag, or a ROS 2 bag, which may be a folder.

    The signals of a `sensor_msgs/JointState` are named by joint: ``/joint_states.position.elbow``.
    Each topic has its own clock: the stamps in the headers of its messages, or, without headers,
    the times at which they were logged.
    """
    files = files_of(path)
    topics, others = _scan(files)
    series, notes = [], {}
    for topic in topics.values():
        for name, signal in topic.signals.items():
            series.append(Series(name, "number", topic.count, signal.unit, signal.clock))
            if not topic.stamped:
                notes[signal.clock] = (
                    f"the messages of {signal.clock!r} carry no time stamps, so the times at which "
                    f"they were logged were taken: log a message with a header"
                )
    return Contents(series, partial(_frames, files, topics), others, notes)


def decoder(topic: Topic) -> tuple[Callable[[bytes], Any] | None, str]:
    """Return the decoder of a topic's messages, or None and the reason."""
    if topic.encoding == "json":
        return json.loads, ""
    if topic.encoding not in ("cdr", "ros1"):
        return None, f"messages of encoding {topic.encoding[:40]!r}, which are not read"
    if not _TYPE_NAME.fullmatch(topic.kind) or len(topic.definition) > _LONGEST_DEFINITION:
        return None, "messages of a type whose name or definition cannot be read"
    from rosbags.typesys.msg import normalize_msgtype

    kind = normalize_msgtype(topic.kind)
    try:
        store = _store(topic, kind)
    except Exception:  # rosbags raises various errors for a bad definition
        return None, "messages of a type whose definition cannot be read"
    if kind not in store.types:
        return None, f"messages of type {topic.kind[:80]!r}, without a definition in the file"
    decode = store.deserialize_ros1 if topic.encoding == "ros1" else store.deserialize_cdr
    return lambda raw: decode(raw, kind), ""


def _store(topic: Topic, kind: str) -> Any:
    """Store of the message types of a topic."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if not topic.definition:
        return get_typestore(Stores.LATEST)
    if topic.language == "ros2idl":
        types = get_types_from_idl(topic.definition)
    else:
        types = get_types_from_msg(topic.definition, kind)
    # rosbags generates Python code with the names of the types, so these must be harmless.
    if not all(map(_TYPE_NAME.fullmatch, types)):
        raise ValueError("a type has an invalid name")
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store


def _messages(
    files: list[Path], topics: set[str] | None = None
) -> Iterator[tuple[Topic, int, bytes]]:
    """Yield messages of some topics, or of all, with the times of logging in ns."""
    for path in files:
        with path.open("rb") as opened:
            is_mcap = opened.read(5) == b"\x89MCAP"
        source = _of_mcap(path) if is_mcap else _of_bag(path, topics)
        for message in source:
            if topics is None or message[0].name in topics:
                yield message


def _of_mcap(path: Path) -> Iterator[tuple[Topic, int, bytes]]:
    from mcap.reader import NonSeekingReader

    with path.open("rb") as opened:
        reader = NonSeekingReader(opened, record_size_limit=_LARGEST_RECORD)
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            kind, language, definition = "", "", ""
            if schema is not None:
                kind, language = schema.name, schema.encoding
                definition = schema.data.decode(errors="replace")
            topic = Topic(channel.topic, kind, channel.message_encoding, definition, language)
            yield topic, message.log_time, message.data


def _of_bag(path: Path, topics: set[str] | None) -> Iterator[tuple[Topic, int, bytes]]:
    from rosbags.interfaces import MessageDefinitionFormat

    if path.suffix == ".bag":
        from rosbags.rosbag1 import Reader

        encoding, language = "ros1", "ros1msg"
    else:
        from rosbags.rosbag2 import Reader

        encoding, language = "cdr", "ros2msg"
    with Reader(path) as reader:
        wanted: list[Any] = [c for c in reader.connections if topics is None or c.topic in topics]
        known = {}
        for one in wanted:
            is_idl = one.msgdef.format == MessageDefinitionFormat.IDL
            syntax = "ros2idl" if is_idl else language
            known[one.id] = Topic(one.topic, one.msgtype, encoding, one.msgdef.data, syntax)
        if wanted:
            for connection, time, raw in reader.messages(connections=wanted):
                yield known[connection.id], time, bytes(raw)


def _scan(files: list[Path]) -> tuple[dict[str, _TopicContents], dict[str, str]]:
    """Return topics with the fields of their first messages, and what is no signal."""
    topics: dict[str, _TopicContents] = {}
    others: dict[str, str] = {}
    for topic, _, raw in _messages(files):
        known = topics.get(topic.name)
        if known is None:
            decode, why = decoder(topic)
            known = topics[topic.name] = _TopicContents(decode)
            if decode is None:
                others[topic.name] = why
        known.count += 1
        if known.decode is None or known.count > _SCANNED:
            continue
        message = known.decode(raw)
        if known.stamped is None:
            known.stamped = bool(_stamp_of(message))
        for path, value, joint in _numbers(message):
            name = topic.name + path
            if isinstance(value, str):
                others[name] = value
            else:
                unit = _JOINT_STATE[path.split(".")[1]] if joint else ""
                clock = f"{topic.name} of {joint}" if joint else topic.name
                known.signals.setdefault(name, _Signal(unit, clock, joint))
    return topics, others


def _frames(
    files: list[Path], topics: dict[str, _TopicContents], paths: Collection[str], size: int
) -> Iterator[Frame]:
    """Yield values of chosen signals, for all clocks each time one of them has `size`."""
    chosen = {
        topic: {path: signal for path, signal in known.signals.items() if path in paths}
        for topic, known in topics.items()
    }
    chosen = {topic: signals for topic, signals in chosen.items() if signals}
    held: dict[str, dict[str, array]] = {}
    for signals in chosen.values():
        for path, signal in signals.items():
            held.setdefault(signal.clock, {STAMPS: array("q")})[path] = array("d")
    counts = dict.fromkeys(chosen, 0)
    for topic, logged, raw in _messages(files, {*chosen}):
        known = topics[topic.name]
        assert known.decode is not None
        message = known.decode(raw)
        counts[topic.name] += 1
        values = _values(message, topic.name, counts[topic.name], chosen[topic.name])
        for clock in {chosen[topic.name][path].clock for path in values}:
            held[clock][STAMPS].append(_stamp_of(message) if known.stamped else logged)
        for path, value in values.items():
            held[chosen[topic.name][path].clock][path].append(value)
        if any(len(columns[STAMPS]) >= size for columns in held.values()):
            yield from _flush(held)
    yield from _flush(held)


def _flush(held: dict[str, dict[str, array]]) -> Iterator[Frame]:
    """Yield the collected values of each clock, and clear them."""
    for clock, columns in held.items():
        if columns[STAMPS]:
            yield clock, {path: np.array(values) for path, values in columns.items()}
        for values in columns.values():
            del values[:]


def _values(message: Any, topic: str, number: int, signals: dict[str, _Signal]) -> dict[str, float]:
    """Values of the signals in a message; raise if one is missing, unless its joint is."""
    found = {topic + path: value for path, value, _ in _numbers(message)}
    values = {}
    for path, signal in signals.items():
        value = found.get(path)
        if isinstance(value, float):
            values[path] = value
        elif not signal.joint or signal.joint in (_fields(message).get("name") or ()):
            raise RefusedError(
                f"message {number} of {topic!r}", f"{path!r} is missing: log it in each message"
            )
    return values


def _fields(message: Any) -> dict[str, Any]:
    """Fields of a message by name; empty for anything else."""
    return message if isinstance(message, dict) else getattr(message, "__dict__", {})


def _numbers(message: Any) -> Iterator[tuple[str, float | str, str]]:
    """Yield path, value (a text if it is no number) and joint of each field of a message."""
    fields = _fields(message)
    names = fields.get("name")
    if all(fields.get(key) is not None for key in _JOINT_STATE) and isinstance(names, list):
        for key in _JOINT_STATE:
            for name, value in zip(names, fields[key], strict=False):
                yield f".{key}.{name}", float(value), str(name)
        return
    for name, value in fields.items():
        if name not in ("header", "structure_needs_at_least_one_member"):
            for path, number in _nested_numbers(value):
                yield f".{name}{path}", number, ""


def _nested_numbers(value: Any) -> Iterator[tuple[str, float | str]]:
    if isinstance(value, bool | np.bool_) or value is None:
        return
    if isinstance(value, int | float | np.integer | np.floating):
        yield "", float(value)
    elif isinstance(value, str):
        yield "", "text"
    elif isinstance(value, list | np.ndarray) and len(value) > WIDEST:
        yield "", f"{len(value)} values in each message"
    else:
        is_list = isinstance(value, list | np.ndarray)
        inner = enumerate(value) if is_list else _fields(value).items()
        for name, one in inner:
            for path, number in _nested_numbers(one):
                yield (f"[{name}]{path}" if is_list else f".{name}{path}"), number


def _stamp_of(message: Any) -> int:
    """Time stamp in a message's header, in ns; zero if it has none."""
    stamp = _fields(_fields(_fields(message).get("header")).get("stamp"))
    seconds = stamp.get("sec")
    parts = (stamp.get(name) for name in ("nanosec", "nsec", "nsecs"))
    rest = next((part for part in parts if part is not None), 0)
    return int(seconds) * 1_000_000_000 + int(rest) if isinstance(seconds, int) else 0
