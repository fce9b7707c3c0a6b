"""Checks of requests before the studio handles them, and of uploaded logs."""

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


# A page of another origin can send requests to the loopback and, with a host name that resolves to
# 127.0.0.1, read the answers. So host and origin of a request must be the studio's own.
class Guard:
    """ASGI middleware that refuses requests from other pages or under other host names."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse a request or pass it to the application."""
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
        """Return `send` with security headers added to each response."""

        async def sending(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        return sending

    def _refusal(self, scope: Scope) -> Response | None:
        """Return the response that refuses a request; None if it may pass."""
        connection = HTTPConnection(scope)
        host = connection.headers.get("host", "")
        if not _is_ours(host):
            return _refused("the host name is not the studio's: open the address that it printed")
        origin = connection.headers.get("origin")
        acts = scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")
        if (origin is None and acts) or (
            origin is not None and origin not in (f"http://{host}", f"https://{host}")
        ):
            return _refused("the request comes from another page: open the studio's address")
        return None


def _is_ours(host: str) -> bool:
    """Whether a Host header is localhost or a loopback number, which DNS cannot redirect."""
    try:
        name = urlsplit(f"//{host}").hostname or ""
        return name == "localhost" or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False


def _refused(reason: str) -> Response:
    return PlainTextResponse(f"flexid studio: {reason}\n", 403)


LARGEST_UPLOAD = 100_000_000  # bytes; reading one takes about four times that in memory
SUFFIXES = suffixes()
_LONGEST_NAME = 80


@dataclass(eq=False, repr=False)
class UploadError(FlexidError):
    """A log cannot be uploaded."""

    reason: str
    status: int  # of HTTP
    _text = "{reason}"


def safe_name(name: str) -> str:
    """Return a safe file name: the last part of a browser's name, in plain characters."""
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
    """Write an uploaded log into a folder and return its path; raise if it is too large."""
    path = folder / safe_name(name)
    size, part = 0, folder / f".{secrets.token_hex(8)}"  # no safe name starts with a dot
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
