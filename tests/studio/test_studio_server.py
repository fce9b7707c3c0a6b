"""How the studio is started, and what is said where it cannot be."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import pytest

from flexid.studio import guard, server
from flexid.studio.jobs import Workers
from flexid.studio.window import Offer, Window


def test_without_the_package(flexid, monkeypatch: pytest.MonkeyPatch):
    """Assert that the sentence names the extra."""
    monkeypatch.setattr(server, "find_spec", lambda _: None)
    outcome = flexid("studio", "--no-browser")
    assert outcome.status == 2
    assert "pip install 'flexid[studio]'" in outcome.stderr


def test_a_port_that_is_taken(flexid):
    """Assert that another port is asked for."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        outcome = flexid("studio", "--no-browser", "--port", port)
    assert outcome.status == 2
    assert f"port {port}" in outcome.stderr
    assert "--port" in outcome.stderr


def test_off_the_loopback_the_address_has_a_token(start):
    """Assert that a studio on the network lets nobody in without what it printed."""
    with start("--host", "0.0.0.0") as address:
        port = address.split(":")[2].split("/")[0]
        token = address.partition("token=")[2]
        assert len(token) >= 32
        here = f"http://127.0.0.1:{port}/"
        with pytest.raises(OSError, match="403"):
            urlopen(here, timeout=10)
        with urlopen(
            Request(here, headers={"Cookie": f"flexid_studio={token}"}), timeout=10
        ) as page:
            assert b"flexid studio" in page.read()


def test_one_window_too_many_is_told():
    """Assert that the window says why it stays empty."""
    sent: list[dict[str, Any]] = []

    class Socket:
        async def accept(self) -> None:
            """Take the window."""

        async def send_json(self, message: dict[str, Any]) -> None:
            sent.append(message)

        async def iter_text(self) -> AsyncIterator[str]:
            yield '{"kind": "open"}'

    windows: dict[str, Any] = dict.fromkeys(map(str, range(server.MOST_WINDOWS)))
    socket: Any = Socket()
    asyncio.run(server._window(Offer(None, *[Workers(0)] * 3), windows)(socket))
    assert "close one and reload" in sent.pop()["text"]
    assert sent == []


class Sent:
    """A log that arrives."""

    path_params = {"key": "a"}  # noqa: RUF012
    headers = {"x-file-name": "a.csv"}  # noqa: RUF012

    def stream(self) -> None:
        """Return nothing: `save` is replaced."""


@pytest.mark.parametrize("gone", [False, True])
def test_a_log_that_comes_too_late_is_refused(
    gone: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Assert that nothing begins where the window was closed while its log was sent."""

    class Room:
        window = Window

        def uploaded(self, _: Path) -> None:
            raise AssertionError("a job was begun")

    async def save(*_: object) -> Path:
        windows.clear()
        if gone:
            raise FileNotFoundError(2, "gone")
        path = tmp_path / "a.csv"
        path.touch()
        return path

    room: Any = Room()
    room.window = type("", (), {"folder": tmp_path})
    windows: dict[str, Any] = {"a": room}
    monkeypatch.setattr(guard, "save", save)
    answer = asyncio.run(server._upload(windows)(Sent()))
    assert answer.status_code == 404
    assert b"reload the page" in answer.body
    assert not [*tmp_path.iterdir()]
