"""Web server of the studio: routes, windows and start."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from flexid.errors import SettingError
from flexid.readers.formats import kinds, suffixes
from flexid.studio.guard import Guard, UploadError, save
from flexid.studio.jobs import REPORT, Workers
from flexid.studio.window import Offer, Rooms, Window, assets, fragment

if TYPE_CHECKING:
    from starlette.types import ASGIApp

_LOOPBACK = "127.0.0.1"
_FRAMED = {"Content-Security-Policy": "frame-ancestors 'self'", "X-Frame-Options": "SAMEORIGIN"}
_LONG, _SHORT, _PLAY = 2, 1, 1  # processes


class Studio:
    """Open windows, and the handlers of the server's routes."""

    def __init__(self, offer: Offer) -> None:
        self._offer = offer
        self.windows: dict[str, Rooms] = {}

    def application(self) -> Starlette:
        """Return the application with all routes."""
        routes = [
            Route("/", self.page),
            Route("/assets/{name}", self.asset),
            Route("/upload/{key}", self.upload, methods=["POST"]),
            Route("/files/{key}/{name}", self.file),
            Route("/report/{key}", self.file),
            WebSocketRoute("/socket", self.window),
        ]
        return Starlette(routes=routes)

    async def window(self, socket: WebSocket) -> None:
        """Serve a window's socket: JSON requests come in, updates of the page go out."""

        async def send(message: dict[str, Any]) -> None:
            with suppress(WebSocketDisconnect, RuntimeError):  # the page may be gone
                await socket.send_json(message)

        await socket.accept()
        rooms = Rooms(Window(self._offer, send))
        self.windows[rooms.window.key] = rooms
        try:
            async for text in socket.iter_text():
                with suppress(ValueError):  # text that is not JSON does not come from our page
                    if isinstance(request := json.loads(text), dict):
                        await rooms.handle(request)
        finally:
            await self.windows.pop(rooms.window.key).window.close()

    async def page(self, _: Request) -> Response:
        """Return the empty page, which then opens its window."""
        return HTMLResponse(fragment("studio.html", suffixes=",".join(suffixes()), kinds=kinds()))

    async def asset(self, request: Request) -> Response:
        """Return a script or a style sheet."""
        content, kind = assets().get(request.path_params["name"], (None, ""))
        return Response(status_code=404) if content is None else Response(content, media_type=kind)

    async def upload(self, request: Request) -> Response:
        """Save a log that a page sends, and start its identification room with it."""
        ended = JSONResponse({"problem": "this window has ended: reload the page"}, 404)
        key = request.path_params["key"]
        rooms = self.windows.get(key)
        if rooms is None:
            return ended
        name = unquote(request.headers.get("x-file-name", ""))
        try:
            path = await save(request.stream(), name, rooms.window.folder)
        except UploadError as error:
            return JSONResponse({"problem": str(error)}, error.status)
        except OSError as error:
            if key not in self.windows:  # its folder was deleted
                return ended
            problem = f"the log cannot be saved ({error.strerror}): send it again"
            return JSONResponse({"problem": problem}, 507)
        if key not in self.windows:
            path.unlink(missing_ok=True)
            return ended
        rooms.identify.uploaded(path)
        return JSONResponse({"name": path.name})

    async def file(self, request: Request) -> Response:
        """Return a file of a result as a download, or without a name the report for a frame."""
        rooms = self.windows.get(request.path_params["key"])
        name = request.path_params.get("name")
        path = rooms and rooms.window.files.get(name or REPORT)
        if path is None:
            return Response(status_code=404)
        if name is None:  # the report's own policy allows no script
            return FileResponse(path, media_type="text/html", headers=_FRAMED)
        return FileResponse(path, filename=path.name, media_type="application/octet-stream")


def studio(log: Path | None) -> ASGIApp:
    """Create the studio as an ASGI application; each window opens with the log if given."""
    log = log and log.absolute()  # worker processes change their folder with each job
    offer = Offer(log, *(Workers(most) for most in (_LONG, _SHORT, _PLAY)))
    return Guard(Studio(offer).application())


def serve(log: Path | None, port: int, announce: Callable[[str], None]) -> None:
    """Serve the studio until it is interrupted."""
    listening = _listening(port)
    port = listening.getsockname()[1]

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            announce(f"http://{_LOOPBACK}:{port}/")

    config = uvicorn.Config(
        studio(log),
        log_level="warning",
        ws_max_size=1_000_000,
        timeout_graceful_shutdown=2,
        server_header=False,
    )
    with listening:
        Server(config).run(sockets=[listening])


def _listening(port: int) -> socket.socket:
    try:
        return socket.create_server((_LOOPBACK, port))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SettingError(
            "port", f"cannot listen on port {port} ({reason}): give another with --port"
        ) from None
