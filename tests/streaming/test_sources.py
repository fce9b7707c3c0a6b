"""Bytes from a growing file, standard input, datagrams and a serial port."""

import os
import socket
import sys
import threading
import time
from pathlib import Path

import pytest

from flexid.errors import RecordingError, SettingError
from flexid.streaming import sources
from flexid.streaming.follower import Follower
from flexid.streaming.sources import Datagrams, Source, open_source

LINES = [b"time,a\n", b"0.1,2\n", b"0.2,3\n"]


@pytest.fixture
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave a file that was replaced at once."""
    monkeypatch.setattr(sources, "LINGER", 0.0)


def collected(source: Source, wanted: int) -> bytes:
    """What a source gives until it has given so much, or has been silent for long."""
    found, silent = b"", 0
    while len(found) < wanted and silent < 50:
        data = source.read()
        if data is None:
            break
        silent = 0 if data else silent + 1
        found += data
    return found


def test_a_file_that_grows(tmp_path: Path):
    """Assert that what is written later is read later, and that the end is waited at."""
    path = tmp_path / "log.csv"
    path.write_bytes(LINES[0])
    source = open_source(str(path))
    assert source.read() == LINES[0]
    assert source.read() == b""
    with path.open("ab") as file:
        file.write(LINES[1])
    assert source.read() == LINES[1]
    path.write_bytes(b"x\n")  # the recorder began again
    assert collected(source, 2) == b"x\n"
    source.close()


def test_a_file_that_is_cut_and_has_grown_again(tmp_path: Path):
    """Assert that a file is read from its beginning that is as long as before, but another."""
    path = tmp_path / "log.csv"
    path.write_bytes(b"".join(LINES))
    source = open_source(str(path))
    assert (source.read(), source.begins) == (b"".join(LINES), False)
    path.write_bytes(b"time,a\n0.1,4\n0.2,5\n0.3,6\n")
    assert (source.read(), source.begins) == (b"time,a\n0.1,4\n0.2,5\n0.3,6\n", True)
    assert (source.read(), source.begins) == (b"", False)
    source.close()


def renamed(folder: Path) -> tuple[Path, Source]:
    """The path of a log that was read and then renamed, and who reads it."""
    path = folder / "log.csv"
    path.write_bytes(LINES[0])
    source = open_source(str(path))
    assert source.read() == LINES[0]
    path.rename(folder / "log.1")
    return path, source


@pytest.mark.usefixtures("at_once")
def test_a_file_that_is_replaced(tmp_path: Path):
    """Assert that a log that is renamed is read to its end, and then the one that took its name."""
    path, source = renamed(tmp_path)
    assert source.read() == b""  # there is none yet
    path.touch()
    assert (source.read(), source.begins) == (b"", False)  # nor anything in it
    with (tmp_path / "log.1").open("ab") as file:
        file.write(LINES[1])
    assert (source.read(), source.begins) == (LINES[1], False)
    path.write_bytes(LINES[0])
    assert (source.read(), source.begins) == (LINES[0], True)
    with path.open("ab") as file:
        file.write(LINES[2])
    assert (source.read(), source.begins) == (LINES[2], False)
    source.close()


@pytest.mark.usefixtures("at_once")
def test_what_came_between_two_looks_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that the file of before is read once more when the new one has something."""
    path, source = renamed(tmp_path)
    path.write_bytes(LINES[2])
    real = os.path.samestat

    def late(*stats: os.stat_result) -> bool:
        with (tmp_path / "log.1").open("ab") as file:
            file.write(LINES[1])
        monkeypatch.setattr(os.path, "samestat", real)
        return real(*stats)

    monkeypatch.setattr(os.path, "samestat", late)
    assert (source.read(), source.begins) == (LINES[1], False)
    assert (source.read(), source.begins) == (LINES[2], True)
    source.close()


def test_a_recorder_that_is_slow_to_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Assert that what comes into a renamed file after the new one has begun is read first.

    The new one is renamed too meanwhile, and is not lost.
    """
    clock = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    path, source = renamed(tmp_path)
    path.write_bytes(b"time,a\n0.3,4\n")
    for line in LINES[1:]:
        assert source.read() == b""
        clock[0] += 0.9 * sources.LINGER
        with (tmp_path / "log.1").open("ab") as file:
            file.write(line)
        assert (source.read(), source.begins) == (line, False)
    path.rename(tmp_path / "log.2")
    path.write_bytes(b"time,a\n0.4,5\n")
    clock[0] += 1.1 * sources.LINGER
    assert (source.read(), source.begins) == (b"time,a\n0.3,4\n", True)
    assert source.read() == b""
    clock[0] += 1.1 * sources.LINGER
    assert (source.read(), source.begins) == (b"time,a\n0.4,5\n", True)
    source.close()


def test_a_file_that_ends(tmp_path: Path):
    """Assert that the end is one where that is wanted."""
    path = tmp_path / "log.csv"
    path.write_bytes(LINES[0])
    source = open_source(str(path), stop_at_end=True)
    assert (source.read(), source.read()) == (LINES[0], None)
    source.close()


def test_standard_input(monkeypatch: pytest.MonkeyPatch):
    """Assert that a pipe is read until its other end is closed."""
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        source = open_source("-")
        assert source.read() == b""
        os.write(writing, LINES[0])
        assert source.read() == LINES[0]
        os.close(writing)
        assert source.read() is None


def test_datagrams():
    """Assert that each datagram is a line of its own, and several in one are several."""
    source = open_source("udp://127.0.0.1:0")
    assert isinstance(source, Datagrams)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for line in (LINES[0].strip(), LINES[1] + LINES[2]):
            sender.sendto(line, ("127.0.0.1", source.port))
    assert collected(source, 19) == b"".join(LINES)
    assert source.read() == b""
    source.close()


def test_datagrams_that_nobody_reads_are_bounded(monkeypatch: pytest.MonkeyPatch):
    """Assert that of more than may wait the oldest are lost, and the latest are not."""
    monkeypatch.setattr(sources, "_MOST_WAITING", 9)
    source = Datagrams("udp://:0")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for number in range(30):
            sender.sendto(b"%02d" % number, ("127.0.0.1", source.port))
    for _ in range(500):
        if source._came and source._came[-1].startswith(b"29"):
            break
        time.sleep(0.01)
    lines = (source.read() or b"").splitlines()
    source.close()
    assert [line[:2] for line in lines] == [b"%02d" % number for number in range(21, 30)]


@pytest.mark.parametrize(
    ("address", "is_open"),
    [
        ("udp://:0", False),
        ("udp://localhost:0", False),
        ("udp://[::1]:0", False),
        ("udp://0.0.0.0:0", True),
    ],
)
def test_nothing_listens_to_others_unless_told(address: str, is_open: bool):
    """Assert that only an address of its own opens a port to other machines."""
    try:
        source = Datagrams(address)
    except SettingError:
        pytest.skip("this machine has no such address")
    assert source.is_open_to_others is is_open
    source.close()


@pytest.mark.skipif(os.name != "posix", reason="pseudo-terminals are of POSIX systems")
def test_a_serial_port():
    """Assert that lines come through a serial port: a pseudo-terminal stands for its cable."""
    pytest.importorskip("serial", reason="pyserial is not installed")
    import tty

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    source = open_source(f"serial://{os.ttyname(theirs)}?baud=921600")
    writer = threading.Thread(target=lambda: [os.write(ours, line) for line in LINES])
    writer.start()
    assert collected(source, 19) == b"".join(LINES)
    writer.join()
    source.close()
    os.close(ours)
    os.close(theirs)


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("tcp://127.0.0.1:9000", SettingError, "give the path of a file"),
        ("udp://127.0.0.1", SettingError, "is not an address"),
        ("udp://127.0.0.1:99999", SettingError, "is not an address"),
        ("udp://example.org:9000", SettingError, "is not an address"),
        ("udp://127.0.0.1:9000/x", SettingError, "is not an address"),
        ("serial://", SettingError, "is not a port"),
        ("serial:///dev/ttyS0?baud=fast", SettingError, "is not a port"),
        ("serial:///dev/ttyS0?parity=even", SettingError, "is not a port"),
        ("serial:///dev/no_such_port", RecordingError, "cannot be opened"),
        ("no/such/file.csv", RecordingError, "no such file"),
        (".", RecordingError, "is a folder"),
    ],
)
def test_what_is_no_source(text: str, error: type[Exception], words: str):
    """Assert that each gets a sentence with what to give instead."""
    with pytest.raises(error, match=words):
        open_source(text)


def test_ports():
    """Assert that two cannot listen to the same, and one open to the network is warned of."""
    first = Datagrams("udp://127.0.0.1:0")
    with pytest.raises(SettingError, match="another port"):
        Datagrams(f"udp://127.0.0.1:{first.port}")
    first.close()
    follower = Follower("udp://0.0.0.0:0", {})
    turns = follower.turns(1.0)
    next(turns)
    turns.close()
    (warning,) = follower.warnings
    assert "whoever reaches this machine" in warning
