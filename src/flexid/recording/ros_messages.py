"""Messages of MCAP files and ROS bags as they were recorded, and what decodes them."""

from __future__ import annotations

import bz2
import io
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

from flexid.errors import RecordingError
from flexid.files import shown
from flexid.recording.limits import LARGEST_HELD
from flexid.recording.outside import OutsideFile

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

    Decode: TypeAlias = Callable[[bytes], Any]

WHAT = "bag or MCAP file"
SUFFIXES = (".mcap", ".db3")
_LARGEST_CHUNK = 1_000_000_000  # bytes, unpacked
_FIRST_PIECE = 1 << 20  # bytes
_LONGEST_DEFINITION = 200_000  # characters
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*){1,3}")
_BZ2, _LZ4 = b"BZh", b"\x04\x22\x4d\x18"


class Topic(NamedTuple):
    """A topic and how its messages are written.

    Parameters
    ----------
    name : str
    kind : str
        Name of the messages' type.
    encoding : str
        ``cdr``, ``ros1`` or ``json``; of others the messages are not read.
    definition : str
        Of the type; empty where the file has none.
    language : str
        Of the definition: ``ros1msg``, ``ros2msg`` or ``ros2idl``.
    """

    name: str
    kind: str
    encoding: str
    definition: str
    language: str


class _Unpacker(Protocol):
    """What bz2 and lz4 have in common."""

    @property
    def eof(self) -> bool | None: ...

    def decompress(self, data: bytes, max_length: int) -> bytes: ...


def bag_files(path: Path) -> list[Path]:
    """The files of a bag, which in ROS 2 may be a folder.

    Raises
    ------
    RecordingError
        If a folder holds no bag, or one that is compressed as a whole.
    """
    if not path.is_dir():
        return [path]
    inside = sorted(path.iterdir())
    for suffix in SUFFIXES:
        files = [one for one in inside if one.suffix == suffix]
        if files:
            return files
    reason = "this is a folder: give the path of a log in it"
    if any(one.suffix in (".zst", ".zstd") for one in inside):
        reason = "this bag is compressed as a whole: unpack its files with zstd -d --rm"
    raise RecordingError(shown(path), "", reason)


def raw_messages(
    file: str, files: list[Path], topics: set[str] | None = None
) -> Iterator[tuple[Topic, int, bytes]]:
    """Messages of a bag, each with its topic and the time in ns at which it was logged.

    Parameters
    ----------
    file : str
        For messages.
    files : list of Path
        Of one bag.
    topics : set of str or None
        Of which topics; None for all.

    Raises
    ------
    RecordingError
        If a chunk of messages is too large when it is unpacked.
    """
    left = LARGEST_HELD
    for path in files:
        with path.open("rb") as opened:
            is_mcap = opened.read(5) == b"\x89MCAP"
        if is_mcap:
            source = _of_mcap(file, path, topics)
        elif path.suffix == ".bag":
            source = _of_rosbag1(file, path, topics)
        else:
            source = _of_sqlite(path, topics)
        for topic, time, raw in source:
            left -= len(raw)
            if left < 0:
                raise _too_large(file)
            yield topic, time, raw


def decoder(topic: Topic) -> tuple[Decode | None, str]:
    """What decodes the messages of a topic, or None, and why there is nothing."""
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
    except Exception:  # whatever rosbags makes of a definition that is none
        return None, "messages of a type whose definition cannot be read"
    if kind not in store.types:
        return None, f"messages of type {topic.kind[:80]!r}, of which the file has no definition"
    if topic.encoding == "ros1":
        return lambda raw: store.deserialize_ros1(raw, kind), ""
    return lambda raw: store.deserialize_cdr(raw, kind), ""


def _store(topic: Topic, kind: str) -> Typestore:
    """The types that a topic's messages are made of."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if not topic.definition:
        return get_typestore(Stores.LATEST)
    if topic.language == "ros2idl":
        types = get_types_from_idl(topic.definition)
    else:
        types = get_types_from_msg(topic.definition, kind)
    # rosbags makes Python code of them, in which their names stand.
    if not all(map(_TYPE_NAME.fullmatch, types)):
        raise ValueError("a type's name is no name")
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store


def _of_mcap(file: str, path: Path, topics: set[str] | None) -> Iterator[tuple[Topic, int, bytes]]:
    from mcap.records import Channel, Chunk, Message, Schema
    from mcap.stream_reader import StreamReader, breakup_chunk

    schemas: dict[int, Schema] = {}
    channels: dict[int, Topic] = {}
    with OutsideFile(path) as opened:
        reader = StreamReader(opened, emit_chunks=True, record_size_limit=_LARGEST_CHUNK)
        for outer in reader.records:
            records = [outer]
            if isinstance(outer, Chunk):
                outer.data = _unpacked(file, outer.data, outer.compression)
                outer.compression = ""
                records = breakup_chunk(outer)
            for record in records:
                if isinstance(record, Schema):
                    schemas[record.id] = record
                elif isinstance(record, Channel):
                    schema = schemas.get(record.schema_id)
                    channels[record.id] = Topic(
                        record.topic,
                        schema.name if schema else "",
                        record.message_encoding,
                        schema.data.decode(errors="replace") if schema else "",
                        schema.encoding if schema else "",
                    )
                elif isinstance(record, Message):
                    topic = channels[record.channel_id]
                    if topics is None or topic.name in topics:
                        yield topic, record.log_time, record.data


def _unpacked(file: str, data: bytes, compression: str) -> bytes:
    """A chunk's records, of which no more than a limit are unpacked.

    Libraries reserve what they may unpack to before they do, so little is asked for at first.
    """
    read = _reader(data, compression)
    pieces, size = [], 0
    while piece := read(max(size, _FIRST_PIECE)):
        pieces.append(piece)
        size += len(piece)
        if size > _LARGEST_CHUNK:
            raise _too_large(file)
    return b"".join(pieces)


def _reader(data: bytes, compression: str) -> Callable[[int], bytes]:
    """A function that unpacks on, to so many bytes at most; to none at the end."""
    if compression == "zstd":
        import zstandard

        return zstandard.ZstdDecompressor().stream_reader(data).read
    if compression == "lz4":
        import lz4.frame

        return _read_on(lz4.frame.LZ4FrameDecompressor(), data)
    if compression == "bz2":
        return _read_on(bz2.BZ2Decompressor(), data)
    return io.BytesIO(data).read


def _read_on(unpacker: _Unpacker, data: bytes) -> Callable[[int], bytes]:
    left = [data]

    def read(most: int) -> bytes:
        return b"" if unpacker.eof else unpacker.decompress(left.pop() if left else b"", most)

    return read


def _too_large(file: str) -> RecordingError:
    return RecordingError(
        file,
        "",
        f"unpacked it is larger than {LARGEST_HELD / 1e9:g} GB, or a chunk of it than "
        f"{_LARGEST_CHUNK / 1e9:g} GB, the most that is read: log the topics of one joint",
    )


def _of_rosbag1(
    file: str, path: Path, topics: set[str] | None
) -> Iterator[tuple[Topic, int, bytes]]:
    from rosbags.rosbag1 import Reader

    def unpack(data: bytes) -> bytes:
        kind = "bz2" if data.startswith(_BZ2) else "lz4" if data.startswith(_LZ4) else ""
        return _unpacked(file, data, kind)

    with Reader(_Bag(path)) as reader:
        # Its own would unpack whatever there is.
        reader.chunks = {
            place: chunk._replace(decompressor=unpack) for place, chunk in reader.chunks.items()
        }
        yield from _of_reader(reader, "ros1", "ros1msg", topics)


class _Bag(type(Path())):
    """The path of a bag, from which rosbags reserves no more than there is."""

    def open(self, *_: Any, **__: Any) -> Any:
        """Open it for reading."""
        return OutsideFile(self)


def _of_sqlite(path: Path, topics: set[str] | None) -> Iterator[tuple[Topic, int, bytes]]:
    from rosbags.rosbag2 import Reader

    with Reader(path) as reader:
        yield from _of_reader(reader, "cdr", "ros2msg", topics)


def _of_reader(
    reader: Any, encoding: str, language: str, topics: set[str] | None
) -> Iterator[tuple[Topic, int, bytes]]:
    from rosbags.interfaces import MessageDefinitionFormat

    known = {}
    for one in reader.connections:
        if topics is None or one.topic in topics:
            form = one.msgdef.format
            spoken = "ros2idl" if form == MessageDefinitionFormat.IDL else language
            known[one.id] = Topic(one.topic, one.msgtype, encoding, one.msgdef.data, spoken)
    wanted = [one for one in reader.connections if one.id in known]
    if wanted:
        for connection, time, raw in reader.messages(connections=wanted):
            yield known[connection.id], time, bytes(raw)
