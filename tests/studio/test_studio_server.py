"""The studio's server: access control, uploads, security headers, and worker processes."""

import asyncio
import os
import socket
import sys
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from benchmarks.studio import load

from flexid import studio
from flexid.errors import SettingError
from flexid.studio import guard
from flexid.studio.choices import read_choices
from flexid.studio.guard import Guard, UploadError, safe_name, save
from flexid.studio.jobs import JobError, Workers

HERE = "127.0.0.1:8765"
Headers = dict[str, str]


def answer(headers: Headers, *, method: str = "GET", kind: str = "http") -> tuple[int, Headers]:
    """Return a guard's status and headers; 200 is access, 1008 a closed socket."""
    sent: list[Any] = []

    async def app(_scope: Any, _receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> dict[str, str]:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {
        "type": kind,
        "method": method,
        "path": "/",
        "query_string": b"",
        "headers": [(name.lower().encode(), value.encode()) for name, value in headers.items()],
    }
    guard = Guard(app)
    asyncio.run(guard(scope, receive, send))
    if sent[0]["type"] == "websocket.close":
        return sent[0]["code"], {}
    found = {name.decode(): value.decode() for name, value in sent[0]["headers"]}
    return sent[0]["status"], found


OURS = {"Host": HERE, "Origin": f"http://{HERE}"}
ASKED: tuple[tuple[Headers, dict[str, str], int], ...] = (
    # The loopback is accepted by its own names only, since other names may resolve to it.
    *(({"Host": name}, {}, 200) for name in (HERE, "localhost:8765", "[::1]:8765")),
    *(({"Host": name}, {}, 403) for name in ("evil.example", "127.0.0.1.evil.example", "", "[")),
    *(({"Host": name}, {}, 403) for name in ("10.1.1.1", "localhost.evil.example")),
    # Requests and sockets of other origins are refused.
    *(
        ({"Host": HERE, "Origin": origin}, {"kind": kind}, status)
        for origin in ("http://evil.example", "null", "http://127.0.0.1:9000")
        for kind, status in (("http", 403), ("websocket", 1008))
    ),
    # Changes and sockets need an origin, which must be the studio's.
    ({"Host": HERE}, {"method": "POST"}, 403),
    ({"Host": HERE}, {"kind": "websocket"}, 1008),
    (OURS, {"method": "POST"}, 200),
    (OURS, {"kind": "websocket"}, 200),
)


@pytest.mark.parametrize(("headers", "how", "status"), ASKED)
def test_who_is_let_in(headers: Headers, how: dict[str, str], status: int):
    """Assert that requests of permitted origins are answered, and others refused."""
    assert answer(headers, **how)[0] == status


def test_answers_keep_the_browser_in():
    """Assert that a page can run the studio's scripts only, and cannot be framed."""
    policy = answer({"Host": HERE})[1]["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self'; style-src 'self';" in policy
    assert "frame-ancestors 'none'" in policy


async def chunks(*parts: bytes) -> AsyncIterator[bytes]:
    """Return the body that a browser sends."""
    for part in parts:
        yield part


NAMES = (
    *("run 1.csv", "../../etc/passwd.csv", "..\\..\\windows\\log.CSV", "Messung März.csv"),
    *("<script>alert(1)</script>.csv", "....csv", "-rf.parquet", "a\0b\n\u202e.csv"),
    *("x" * 500 + ".csv", "", "passwd", "log.exe", "log.csv/", "log.html", ".csv.sh"),
)


def test_names_of_uploads(golden: Any):
    """Assert that a name has no path and plain characters only, and is that of a log."""
    found = {}
    for name in NAMES:
        try:
            found[repr(name)[:40]] = safe_name(name)
        except UploadError as error:
            found[repr(name)[:40]] = str(error)
    golden(found)


@pytest.mark.parametrize(("parts", "status"), [((b"12345", b"678901"), 413), ((), 400)])
def test_size_is_bounded(parts: tuple[bytes, ...], status: int, tmp_path: Path, monkeypatch: Any):
    """Assert that oversized and empty uploads are refused, and the log in use is kept."""
    monkeypatch.setattr(guard, "LARGEST_UPLOAD", 10)
    before = asyncio.run(save(chunks(b"time", b",q\n"), "a.csv", tmp_path))
    assert before == tmp_path / "a.csv"
    with pytest.raises(UploadError) as caught:
        asyncio.run(save(chunks(*parts), "a.csv", tmp_path))
    assert caught.value.status == status
    assert before.read_bytes() == b"time,q\n"
    assert [*tmp_path.iterdir()] == [before]


def test_a_studio_that_cannot_start(flexid, monkeypatch: pytest.MonkeyPatch):
    """Assert that an occupied port, and a missing package, are refused with the remedy."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        outcome = flexid("studio", "--no-browser", "--port", port)
    assert outcome.status == 2
    assert f"port {port}" in outcome.stderr
    assert "--port" in outcome.stderr
    monkeypatch.setattr(studio, "find_spec", lambda _: None)
    outcome = flexid("studio", "--no-browser")
    assert outcome.status == 2
    assert "pip install 'flexid[studio]'" in outcome.stderr


def echo(text: str) -> tuple[str, str, int]:
    """Return a text, with the folder and the process."""
    return text, os.getcwd(), os.getpid()


def sleep() -> None:
    """Sleep very long, and leave a mark in the folder."""
    Path("asleep").touch()
    time.sleep(600)


@pytest.mark.anyio
async def test_a_job_is_done_in_its_folder(tmp_path: Path):
    """Assert that a job's answer is returned, and that one process runs several jobs."""
    workers = Workers(1)
    first = await workers.run(echo, "a", folder=tmp_path)
    second = await workers.run(echo, "b", folder=tmp_path)
    assert first == ("a", str(tmp_path), second[2])
    assert first[2] != os.getpid()


@pytest.mark.anyio
async def test_a_cancelled_job_makes_room(tmp_path: Path):
    """Assert that jobs wait for a free process, and that cancelling frees one."""
    workers = Workers(1)
    long = asyncio.create_task(workers.run(sleep, folder=tmp_path))
    while not (tmp_path / "asleep").exists():
        await asyncio.sleep(0.01)
    gone = asyncio.create_task(workers.run(echo, "a", folder=tmp_path))
    waiting = asyncio.create_task(workers.run(echo, "b", folder=tmp_path))
    await asyncio.sleep(0.1)
    assert not waiting.done()
    gone.cancel()
    await asyncio.sleep(0)
    long.cancel()
    assert (await waiting)[0] == "b"


@pytest.mark.anyio
async def test_what_fails_is_said_and_work_goes_on(tmp_path: Path):
    """Assert that bad input, a defect, a process's end or a lost folder stops no other job."""
    workers = Workers(1)
    for job, argument, kind, words in (
        (read_choices, {"model": "none"}, SettingError, "model"),
        ({}.__getitem__, "oh", JobError, "defect"),
        (os._exit, 1, JobError, "ended early"),
    ):
        with pytest.raises(kind, match=words):
            await workers.run(job, argument, folder=tmp_path)
    assert (await workers.run(echo, "a", folder=tmp_path))[0] == "a"
    workers = Workers(1)
    with pytest.raises(JobError, match="folder of the log cannot be entered"):
        await workers.run(echo, "a", folder=tmp_path / "gone")
    assert (await workers.run(echo, "a", folder=tmp_path))[0] == "a"


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
def test_twenty_windows_stay_within_two_gigabytes():
    """Assert that twenty logs are checked, and some identified, within two gigabytes."""
    assert load(20, 2).peak_memory < 2e9
