"""MCAP files and ROS bags: what is found in them, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from joint_log import assert_words, refused
from log_files import COLUMNS, STAMPS, TORQUE, log_file, mcap, measured
from mcap.writer import CompressionType
from rosbags.typesys.store import Typestore

from flexid.readers import guard, ros
from flexid.recording import read_log


def test_topics_at_different_times(tmp_path: Path):
    """Assert that a topic with times of its own is brought to those of the motor's position."""
    log = read_log(mcap(tmp_path / "log.mcap", measured(delay=2_000_000)), TORQUE)
    (recording,) = log.recordings
    assert len(recording) == 99  # no torque was known at the first
    late = np.interp(
        COLUMNS["time"][1:], COLUMNS["time"] + 0.002, COLUMNS["motor_torque"]
    )  # of a curve, at most 5.3**2 * 30 * 0.005**2 / 8 = 0.003 apart
    np.testing.assert_allclose(recording.needed_input, late, atol=0.01)
    assert "'/tau.data' had time stamps of their own" in log.warnings[-1]
    assert any("the messages of '/drive' carry no time stamps" in one for one in log.warnings)


@pytest.mark.parametrize("by", [1, 20])
def test_messages_out_of_order(tmp_path: Path, by: int):
    """Assert that messages which overtook each other are put in the order of their times."""
    messages = measured()
    messages.insert(20 + 2 * by, messages.pop(20))
    (recording,) = read_log(mcap(tmp_path / "log.mcap", messages), TORQUE).recordings
    np.testing.assert_array_equal(recording.motor_position, COLUMNS["motor_position"])


def test_a_number_that_is_missing_in_the_middle(tmp_path: Path):
    """Assert that it is named by its place."""
    messages = measured()
    del messages[101][2]["data"]
    words = "message 51 of '/tau': it has no '/tau.data'"
    assert words in refused(read_log, mcap(tmp_path / "log.mcap", messages), TORQUE)


def test_what_it_holds(tmp_path: Path):
    """Assert that topics, fields and what is no number are listed where a channel is missing."""
    messages = [("/imu", stamp, {"x": 1.0, "image": [0] * 100, "frame": "a"}) for stamp in STAMPS]
    message = refused(read_log, mcap(tmp_path / "log.mcap", messages))
    assert "there is no motor_position" in message
    assert (
        "found '/imu.x' (number, 100 values), '/imu.image' (100 values in each message), "
        "'/imu.frame' (text)" in message
    )


def test_no_times_in_common(tmp_path: Path):
    """Assert that topics which were logged one after the other are refused."""
    path = mcap(tmp_path / "log.mcap", measured(delay=10**12))
    assert "'/drive', '/tau' have no times in common" in refused(read_log, path, TORQUE)


def test_names_that_are_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that a type's name which is no name is not handed to what makes code of it."""
    trap = tmp_path / "executed"
    names = [f"a/msg/B: pass\nopen({str(trap)!r}, 'w')\nclass C", "__import__('os')", "a//b"]
    for name in names:
        decode, why = ros.decoder(ros.Topic("/x", name, "cdr", "float64 data\n", "ros2msg"))
        assert decode is None
        assert "a type whose name" in why
    idl = "module a { module msg { struct B { double data; }; }; };"
    assert ros.decoder(ros.Topic("/x", "a/msg/B", "cdr", idl, "ros2idl"))[0] is not None
    made: list[object] = []
    monkeypatch.setattr(Typestore, "register", lambda _, types: made.append(types))
    inner = f"float64 x\n{'=' * 80}\nMSG: 9c/D\nfloat64 y\n"
    for definition in (inner, "float64"):
        topic = ros.Topic("/x", "a/msg/B", "cdr", definition, "ros2msg")
        assert "definition cannot be read" in ros.decoder(topic)[1]
    assert not made
    assert not trap.exists()


def test_a_bomb(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that a chunk which unpacks to more memory than a limit is refused."""
    monkeypatch.setattr(guard, "LIMITS", guard.LIMITS._replace(memory=150_000_000))
    messages = [("/drive", STAMPS[0], {"zeros": " " * 200_000_000})]
    for compression in (CompressionType.ZSTD, CompressionType.LZ4):
        path = mcap(tmp_path / f"{compression}.mcap", messages, compression)
        assert path.stat().st_size < 1_000_000
        assert_words("MCAP file that can be read|more memory", refused(read_log, path))


@pytest.mark.parametrize(("way", "place", "size"), [("ROS 2, MCAP", 9, 8), ("ROS 1", 13, 4)])
def test_a_damaged_length(tmp_path: Path, way: str, place: int, size: int):
    """Assert that a first record of 900 MB, by what the file says, is refused."""
    path = log_file(tmp_path, way)
    raw = path.read_bytes()
    path.write_bytes(raw[:place] + (900_000_000).to_bytes(size, "little") + raw[place + size :])
    assert "that can be read" in refused(read_log, path)


def test_folders(tmp_path: Path):
    """Assert that a folder without a bag is refused, and one that is compressed as a whole."""
    assert "this is a folder: give the path of a log in it" in refused(read_log, tmp_path)
    (tmp_path / "log_0.db3.zstd").write_bytes(b"")
    assert "unpack its files with zstd -d" in refused(read_log, tmp_path)
