"""Bytes from a growing file, standard input, datagrams and a serial port."""

import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from moving_joint import CHOSEN, same, stream, watched

from flexid.errors import RecordingError, SettingError
from flexid.streaming import sources
from flexid.streaming.checkpoint import save_session
from flexid.streaming.follower import Follower
from flexid.streaming.sources import Datagrams, Source, open_source

LINES = [b"time,a\n", b"0.1,2\n", b"0.2,3\n"]


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


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A log that begins."""
    path = tmp_path / "log.csv"
    path.write_bytes(LINES[0])
    return path


@pytest.fixture
def source(log: Path) -> Iterator[Source]:
    """The log as a source, of which what is there is read."""
    source = open_source(str(log))
    assert source.read() == LINES[0]
    yield source
    source.close()


def test_a_file_that_grows(log: Path, source: Source):
    """Assert that what is written later is read later, and that the end is waited at."""
    assert source.read() == b""
    with log.open("ab") as file:
        file.write(LINES[1])
    assert source.read() == LINES[1]


def replaced(path: Path) -> None:
    """Put another file in the place of one, as logs are rotated."""
    path.rename(path.with_suffix(".1"))
    path.touch()


@pytest.mark.parametrize(
    "act",
    [
        lambda path: path.write_bytes(b"x\n"),
        lambda path: path.write_bytes(b"time,b\n0.1,4\n0.2,5\n0.3,6\n"),
        replaced,
    ],
    ids=["cut", "written again", "replaced"],
)
def test_a_file_that_is_another_is_refused(log: Path, source: Source, act: Callable[[Path], None]):
    """Assert that what is written after a log was cut, also beyond its end, is not read on with."""
    act(log)
    with pytest.raises(RecordingError, match=r"cut, rewritten or replaced .*: watch it once more"):
        source.read()


def test_a_renamed_file_is_read_on(log: Path, source: Source):
    """Assert that nothing is lost of a log that is renamed while nothing stands in its place."""
    later = log.rename(log.with_name("log.1"))
    assert source.read() == b""
    with later.open("ab") as file:
        file.write(LINES[1])
    assert source.read() == LINES[1]


def test_a_file_that_ends(log: Path):
    """Assert that the end is one where that is wanted."""
    source = open_source(str(log), stop_at_end=True)
    assert (source.read(), source.read()) == (LINES[0], None)
    source.close()


def text(samples: np.ndarray) -> str:
    """A log of samples; numbers come back as they were."""
    rows = [",".join(map(repr, row)) for row in samples.tolist()]
    return "\n".join(["time,link_position,motor_position,motor_torque", *rows, ""])


def followed(path: Path, checkpoint: Path | None = None) -> Follower:
    """A follower that has read a file to its end."""
    follower = Follower(str(path), CHOSEN, stop_at_end=True, checkpoint=checkpoint)
    list(follower.turns(1.0))
    return follower


@pytest.mark.parametrize("cut", [1, 1500])
def test_a_checkpoint_knows_the_file_that_was_read_last(tmp_path: Path, cut: int):
    """Assert that what a file has grown by is learnt from, and another file whole."""
    log, state = tmp_path / "log.csv", tmp_path / "state.json"
    samples = stream(6.0)
    log.write_text(text(samples[:1500])[:-9])
    first = followed(log)
    assert first.session is not None
    assert same(first.session, watched(samples[:1499]))
    assert "half a sample" in first.warnings[-1]
    save_session(first.session, state)
    log.write_text(text(samples if cut == 1 else samples[1499:]))
    second = followed(log, state)
    assert second.session is not None
    assert same(second.session, watched(samples))
    assert second.warnings == ()


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
