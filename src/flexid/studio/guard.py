"""Who is let in, before any part of the studio sees a request; and which logs."""

from __future__ import annotations

import ipaddress
import os
import re
import secrets
from collections.abc import AsyncIterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from starlette.datastructures import MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import PlainTextResponse, Response
from starlette.websockets import WebSocketClose

from flexid.errors import FlexidError
from flexid.readers.formats import suffixes

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send


_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; "
        "connect-src 'self'; frame-src 'self'; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


# A page of another origin can send requests to the loopback, and with a name that resolves to
# 127.0.0.1 read the answers. So name and origin of a request have to be the studio's own.
class Guard:
    """An ASGI application that lets through to another what may pass."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or hand it on."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, self._with_headers(send))
        elif scope["type"] == "websocket":
            await WebSocketClose(1008)(scope, receive, send)
        else:
            await refusal(scope, receive, self._with_headers(send))

    def _with_headers(self, send: Send) -> Send:
        """Send with each answer what keeps a browser from doing more than it has to."""

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        return sending

    def _refusal(self, scope: Scope) -> Response | None:
        """The answer to who is not let in; None for who is."""
        connection = HTTPConnection(scope)
        host = connection.headers.get("host", "")
        if not _is_ours(host):
            return _refused("the studio is not called so: open the address that it printed")
        origin = connection.headers.get("origin")
        acts = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        if (origin is None and acts) or (
            origin is not None and origin not in (f"http://{host}", f"https://{host}")
        ):
            return _refused("the request comes from another page")
        return None


def _is_ours(host: str) -> bool:
    """Whether a Host header names the loopback by its number, which nobody can redirect."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def _refused(reason: str) -> Response:
    return PlainTextResponse(f"flexid studio: {reason}\n", 403)


LARGEST_UPLOAD = 100_000_000  # bytes; read at once, at about four times that in memory
SUFFIXES = suffixes()
_LONGEST_NAME = 80


@dataclass(eq=False, repr=False)
class UploadError(FlexidError):
    """A log is not taken."""

    reason: str
    status: int  # of HTTP
    _text = "{reason}"


def safe_name(name: str) -> str:
    """A name for a file from what a browser says: its last part, of plain characters."""
    last = re.split(r"[/\\]", name)[-1]
    stem, dot, suffix = last.rpartition(".")
    if not dot or f".{suffix.lower()}" not in SUFFIXES:
        raise UploadError(
            f"the studio takes logs whose names end in {', '.join(SUFFIXES)}: export the log as "
            f"one of these",
            415,
        )
    plain = re.sub(r"[^\w .()+-]", "_", stem, flags=re.ASCII).lstrip(". -")[:_LONGEST_NAME]
    return f"{plain or 'log'}.{suffix}"


async def save(chunks: AsyncIterator[bytes], name: str, folder: Path) -> Path:
    """Write a log into a folder, as far as it is not too large."""
    path = folder / safe_name(name)
    size, part = 0, folder / f".{secrets.token_hex(8)}"  # no log's name begins so
    try:
        with part.open("wb") as file:
            async for chunk in chunks:
                size += len(chunk)
                if size > LARGEST_UPLOAD:
                    raise UploadError(
                        f"the log is larger than {LARGEST_UPLOAD / 1e6:g} MB, the most that the "
                        f"studio takes: identify it with flexid identify",
                        413,
                    )
                file.write(chunk)
        if not size:
            raise UploadError("the file is empty: export the log again", 400)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return path
