"""MCAP files and ROS bags: what is found in them, and what is refused."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from joint_log import assert_words, joint_columns, refused
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from flexid.readers import guard, ros
from flexid.recording import read_log
from flexid.recording.recording import Recording
from flexid.recording.series import table_of_file, tables_of_file

COLUMNS = joint_columns(100)
STAMPS = [1_700_000_000_000_000_000 + 5_000_000 * index for index in range(100)]
STATE, NUMBER = "sensor_msgs/msg/JointState", "std_msgs/msg/Float64"
STORE1, STORE2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
Write = Callable[[Path], Path]


def state(store: Any, index: int, names: tuple[str, ...] = ("motor", "link")) -> Any:
    """A message of both encoders and the motor's torque, in any order of the joints."""
    stamp = store.types["builtin_interfaces/msg/Time"](
        sec=STAMPS[index] // 10**9, nanosec=STAMPS[index] % 10**9
    )
    sequence = {"seq": index} if store is STORE1 else {}
    header = store.types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **sequence)
    effort = {"motor": COLUMNS["motor_torque"][index], "link": 0.0}
    return store.types[STATE](
        header=header,
        name=list(names),
        position=np.array([COLUMNS[f"{name}_position"][index] for name in names]),
        velocity=np.array([]),
        effort=np.array([effort[name] for name in names]),
    )


def write_all(writer: Any, store: Any, serialize: Callable[[Any, str], Any]) -> None:
    """Write the log as joint states, with a note between."""
    states = writer.add_connection("/joint_states", STATE, typestore=store)
    notes = writer.add_connection("/note", "std_msgs/msg/String", typestore=store)
    for index, stamp in enumerate(STAMPS):
        names = ("motor", "link") if index % 2 else ("link", "motor")
        late = 700_000 * (index % 3)  # the recorder is later than the sensor
        writer.write(states, stamp + late, serialize(state(store, index, names), STATE))
    note = store.types["std_msgs/msg/String"](data="hello")
    writer.write(notes, STAMPS[-1] + 10**9, serialize(note, "std_msgs/msg/String"))


def bag1(path: Path, compression: Any = None) -> Path:
    """A bag of ROS 1."""
    writer = Writer1(path)
    if compression is not None:
        writer.set_compression(compression)
    with writer:
        write_all(writer, STORE1, STORE1.serialize_ros1)
    return path


def bag2(path: Path, plugin: StoragePlugin = StoragePlugin.SQLITE3) -> Path:
    """A bag of ROS 2, which is a folder."""
    with Writer2(path, version=9, storage_plugin=plugin) as writer:
        write_all(writer, STORE2, STORE2.serialize_cdr)
    return path


def assert_is_the_log(recording: Recording) -> None:
    """Assert that the channels are those that were written."""
    np.testing.assert_array_equal(recording.motor_position, COLUMNS["motor_position"])
    np.testing.assert_array_equal(recording.link_position, COLUMNS["link_position"])
    np.testing.assert_array_equal(recording.input, COLUMNS["motor_torque"])
    assert recording.sample_time == pytest.approx(0.005, rel=1e-9)


WAYS: dict[str, Write] = {
    "ROS 1": lambda folder: bag1(folder / "log.bag"),
    "ROS 1, bz2": lambda folder: bag1(folder / "log.bag", Writer1.CompressionFormat.BZ2),
    "ROS 1, lz4": lambda folder: bag1(folder / "log.bag", Writer1.CompressionFormat.LZ4),
    "ROS 2, folder": lambda folder: bag2(folder / "log"),
    "ROS 2, database": lambda folder: bag2(folder / "log") / "log.db3",
    "ROS 2, MCAP in a folder": lambda folder: bag2(folder / "log", StoragePlugin.MCAP),
    "MCAP": lambda folder: bag2(folder / "log", StoragePlugin.MCAP) / "log.mcap",
}


@pytest.mark.parametrize("way", WAYS)
def test_joint_states(tmp_path: Path, way: str):
    """Assert that joints are found by name in each message, at the times in its header."""
    log = read_log(WAYS[way](tmp_path))
    (recording,) = log.recordings
    assert_is_the_log(recording)
    assert log.columns["link_position"].columns == {"/joint_states.position.link [rad]": 1.0}
    assert len(log.warnings) == 1  # that channels were taken by their names


def json_mcap(path: Path, compression: Any, messages: list[tuple[str, int, dict]]) -> Path:
    """An MCAP file of JSON messages, each with topic and time in ns."""
    with path.open("wb") as stream:
        writer = McapWriter(stream, compression=compression)
        writer.start()
        channels: dict[str, int] = {}
        for topic, stamp, message in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(topic, "json", 0)
            raw = json.dumps(message).encode()
            writer.add_message(channels[topic], stamp, raw, stamp)
        writer.finish()
    return path


def measured(delay: int = 0) -> list[tuple[str, int, dict]]:
    """The log as JSON, the torque on a topic of its own with a delay in ns."""
    messages = []
    for index, stamp in enumerate(STAMPS):
        values = {name: COLUMNS[name][index] for name in ("motor_position", "link_position")}
        messages.append(("/drive", stamp, {"joints": [values]}))
        messages.append(("/tau", stamp + delay, {"data": COLUMNS["motor_torque"][index]}))
    return messages


@pytest.mark.parametrize("compression", list(CompressionType))
def test_fields_of_topics(tmp_path: Path, compression: Any):
    """Assert that fields are named topic.field, and that a message without stamp has a warning."""
    path = json_mcap(tmp_path / "log.mcap", compression, measured())
    names = {name: f"/drive.joints[0].{name}" for name in ("motor_position", "link_position")}
    log = read_log(path, {**names, "motor_torque": "/tau.data"})
    assert_is_the_log(log.recordings[0])
    assert "the messages of '/drive' carry no time stamps" in log.warnings[0]


def test_topics_at_different_times(tmp_path: Path):
    """Assert that a topic with times of its own is brought to those of the motor's position."""
    path = json_mcap(tmp_path / "log.mcap", CompressionType.ZSTD, measured(delay=2_000_000))
    log = read_log(path, {"motor_torque": "/tau.data"})
    (recording,) = log.recordings
    assert len(recording) == 99  # no torque was known at the first
    late = np.interp(
        COLUMNS["time"][1:], COLUMNS["time"] + 0.002, COLUMNS["motor_torque"]
    )  # of a curve, at most 5.3**2 * 30 * 0.005**2 / 8 = 0.003 apart
    assert recording.input is not None
    np.testing.assert_allclose(recording.input, late, atol=0.01)
    assert "'/tau.data' had time stamps of their own" in log.warnings[-1]


@pytest.mark.parametrize("by", [1, 20])
def test_messages_out_of_order(tmp_path: Path, by: int):
    """Assert that messages which overtook each other are put in the order of their times."""
    messages = measured()
    messages.insert(20 + 2 * by, messages.pop(20))
    path = json_mcap(tmp_path / "log.mcap", CompressionType.NONE, messages)
    assert_is_the_log(read_log(path, {"motor_torque": "/tau.data"}).recordings[0])


@pytest.mark.parametrize("delay", [0, 2_000_000])
def test_parts_are_the_whole(tmp_path: Path, delay: int):
    """Assert that what is played again, of topics in blocks of the file too, is the whole."""
    messages = sorted(measured(delay), key=lambda message: message[0])
    path = json_mcap(tmp_path / "log.mcap", CompressionType.LZ4, messages)
    names = {"motor_torque": "/tau.data"}
    parts = [table.frame for table in tables_of_file(path, names, 40)]
    assert {part.height for part in parts[:-1]} == {40}
    assert pl.concat(parts).equals(table_of_file(path, names).frame)


def test_a_number_that_is_missing_in_the_middle(tmp_path: Path):
    """Assert that what comes before it is played, and then it is named by its place."""
    messages = measured()
    del messages[101][2]["data"]
    path = json_mcap(tmp_path / "log.mcap", CompressionType.NONE, messages)
    tables = tables_of_file(path, {"motor_torque": "/tau.data"}, 30)
    assert [next(tables).frame.height for _ in range(2)] == [30, 20]
    assert "message 51 of '/tau': it has no '/tau.data'" in refused(next, tables)


def test_damage_behind_what_is_wanted(tmp_path: Path):
    """Assert that messages of another topic which cannot be read are said after all parts."""
    messages = [*measured(), ("/other", STAMPS[0], {"a": 1.0})]
    path = json_mcap(tmp_path / "log.mcap", CompressionType.NONE, messages)
    path.write_bytes(path.read_bytes().replace(b'{"a": 1.0}', b'{"a": 1.0['))
    tables = tables_of_file(path, {"motor_torque": "/tau.data"}, 1000)
    assert next(tables).frame.height == 100
    assert "row 101 or after: the file cannot be read on" in refused(next, tables)


def test_what_it_holds(tmp_path: Path):
    """Assert that topics, fields and what is no number are listed where a channel is missing."""
    messages = [("/imu", stamp, {"x": 1.0, "image": [0] * 100, "frame": "a"}) for stamp in STAMPS]
    message = refused(read_log, json_mcap(tmp_path / "log.mcap", CompressionType.NONE, messages))
    assert "there is no motor_position" in message
    assert (
        "found '/imu.x' (number, 100 values), '/imu.image' (100 values in each message), "
        "'/imu.frame' (text)" in message
    )


def test_no_times_in_common(tmp_path: Path):
    """Assert that topics which were logged one after the other are refused."""
    path = json_mcap(tmp_path / "log.mcap", CompressionType.NONE, measured(delay=10**12))
    message = refused(read_log, path, {"motor_torque": "/tau.data"})
    assert "'/drive', '/tau' have no times in common" in message


def test_names_that_are_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that a type's name which is no name is not handed to what makes code of it."""
    trap = tmp_path / "executed"
    names = [f"a/msg/B: pass\nopen({str(trap)!r}, 'w')\nclass C", "__import__('os')", "a//b"]
    for name in names:
        topic = ros.Topic("/x", name, "cdr", "float64 data\n", "ros2msg")
        decode, why = ros.decoder(topic)
        assert decode is None
        assert "a type whose name" in why
    idl = "module a { module msg { struct B { double data; }; }; };"
    topic = ros.Topic("/x", "a/msg/B", "cdr", idl, "ros2idl")
    assert ros.decoder(topic)[0] is not None
    made: list[object] = []
    monkeypatch.setattr(Typestore, "register", lambda _, types: made.append(types))
    inner = ros.Topic(
        "/x", "a/msg/B", "cdr", f"float64 x\n{'=' * 80}\nMSG: 9c/D\nfloat64 y\n", "ros2msg"
    )
    assert "definition cannot be read" in ros.decoder(inner)[1]
    assert not made
    broken = ros.Topic("/x", "a/msg/B", "cdr", "float64", "ros2msg")
    assert "definition cannot be read" in ros.decoder(broken)[1]
    assert not trap.exists()


def test_a_bomb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that a chunk which unpacks to more memory than a limit is refused."""
    monkeypatch.setattr(guard, "LIMITS", guard.LIMITS._replace(memory=150_000_000))
    messages = [("/drive", STAMPS[0], {"zeros": " " * 200_000_000})]
    for compression in (CompressionType.ZSTD, CompressionType.LZ4):
        path = json_mcap(tmp_path / f"{compression}.mcap", compression, messages)
        assert path.stat().st_size < 1_000_000
        assert_words("MCAP file that can be read|more memory", refused(read_log, path))


@pytest.mark.parametrize(("way", "place", "size"), [("MCAP", 9, 8), ("ROS 1", 13, 4)])
def test_a_damaged_length(tmp_path: Path, way: str, place: int, size: int):
    """Assert that a first record of 900 MB, by what the file says, is refused."""
    path = WAYS[way](tmp_path)
    raw = path.read_bytes()
    path.write_bytes(raw[:place] + (900_000_000).to_bytes(size, "little") + raw[place + size :])
    assert "that can be read" in refused(read_log, path)


def test_folders(tmp_path: Path):
    """Assert that a folder without a bag is refused, and one that is compressed as a whole."""
    assert "this is a folder: give the path of a log in it" in refused(read_log, tmp_path)
    (tmp_path / "log_0.db3.zstd").write_bytes(b"")
    assert "unpack its files with zstd -d" in refused(read_log, tmp_path)


@pytest.mark.parametrize("way", ["ROS 1", "ROS 2, database", "MCAP"])
def test_damaged_files(tmp_path: Path, way: str):
    """Assert that a file cut short is refused."""
    path = WAYS[way](tmp_path)
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    assert_words("that can be read|cannot be read on from there", refused(read_log, path))
