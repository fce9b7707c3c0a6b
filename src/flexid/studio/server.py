"""The studio as a server: its routes, its windows, and how it is started."""

from __future__ import annotations

import json
import secrets
import socket
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from flexid.errors import SettingError
from flexid.readers.formats import kinds, suffixes
from flexid.studio.window import assets, fragment

if TYPE_CHECKING:
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.types import ASGIApp
    from starlette.websockets import WebSocket

    from flexid.studio.window import Offer, Rooms

MOST_WINDOWS = 40
_LONG, _SHORT, _PLAY = 2, 1, 1  # processes


def need_packages() -> None:
    """Raise `SettingError` unless the packages of the extra are installed."""
    for package in ("starlette", "uvicorn", "websockets"):
        if find_spec(package) is None:
            raise SettingError(
                "studio",
                f"it needs {package}, which is not installed: pip install 'flexid[studio]'",
            )


def studio(log: Path | None, host: str, token: str) -> ASGIApp:
    """The studio as an ASGI application; each window opens with the log, if there is one."""
    from starlette.applications import Starlette
    from starlette.routing import Route, WebSocketRoute

    from flexid.studio.guard import Guard
    from flexid.studio.jobs import Workers
    from flexid.studio.window import Offer

    log = log and log.absolute()  # each process changes its folder from job to job
    processes = [Workers(most) for most in (_LONG, _SHORT, _PLAY)]
    windows: dict[str, Rooms] = {}

    @asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        yield
        for workers in processes:
            workers.end()

    routes = [
        Route("/", _page),
        Route("/assets/{name}", _asset),
        Route("/upload/{key}", _upload(windows), methods=["POST"]),
        Route("/files/{key}/{name}", _file(windows)),
        WebSocketRoute("/socket", _window(Offer(log, *processes), windows)),
    ]
    return Guard(Starlette(routes=routes, lifespan=lifespan), host, token)


def _window(
    offer: Offer, windows: dict[str, Rooms]
) -> Callable[[WebSocket], Coroutine[Any, Any, None]]:
    """The end of a window's socket: it asks in JSON, and is sent what its page shows."""
    from starlette.websockets import WebSocketDisconnect

    from flexid.studio.window import Rooms, Window

    async def window(socket: WebSocket) -> None:
        async def send(message: dict[str, Any]) -> None:
            with suppress(WebSocketDisconnect, RuntimeError):  # the page may be gone
                await socket.send_json(message)

        await socket.accept()
        if len(windows) >= MOST_WINDOWS:
            text = f"{MOST_WINDOWS} windows are open, the most there may be: close one and reload"
            await send({"kind": "say", "place": "log-state", "text": text})
            async for _ in socket.iter_text():
                pass  # the page says why it stays empty until it is closed
            return
        rooms = Rooms(Window(offer, send))
        windows[rooms.window.key] = rooms
        try:
            async for text in socket.iter_text():
                with suppress(ValueError):  # what is no JSON is not from our page
                    if isinstance(request := json.loads(text), dict):
                        await rooms.handle(request)
        finally:
            await windows.pop(rooms.window.key).close()

    return window


async def _page(_: Request) -> Response:
    from starlette.responses import HTMLResponse

    return HTMLResponse(fragment("studio.html", suffixes=",".join(suffixes()), kinds=kinds()))


async def _asset(request: Request) -> Response:
    from starlette.responses import Response

    content, kind = assets().get(request.path_params["name"], (None, ""))
    return Response(status_code=404) if content is None else Response(content, media_type=kind)


def _upload(windows: dict[str, Rooms]) -> Callable[..., Any]:
    """The way in for logs."""
    from starlette.responses import JSONResponse

    from flexid.studio.guard import UploadError, save

    def ended() -> Response:
        return JSONResponse({"problem": "this window has ended: reload the page"}, 404)

    async def upload(request: Request) -> Response:
        key = request.path_params["key"]
        rooms = windows.get(key)
        if rooms is None:
            return ended()
        name = unquote(request.headers.get("x-file-name", ""))
        try:
            path = await save(request.stream(), name, rooms.window.folder)
        except UploadError as error:
            return JSONResponse({"problem": str(error)}, error.status)
        except OSError as error:
            if key not in windows:  # its folder was deleted
                return ended()
            problem = f"the log cannot be kept ({error.strerror}): send it again"
            return JSONResponse({"problem": problem}, 507)
        if key not in windows:
            path.unlink(missing_ok=True)
            return ended()
        rooms.uploaded(path)
        return JSONResponse({"name": path.name})

    return upload


def _file(windows: dict[str, Rooms]) -> Callable[..., Any]:
    """The way out for what was found."""
    from starlette.responses import FileResponse, Response

    async def file(request: Request) -> Response:
        rooms = windows.get(request.path_params["key"])
        path = rooms and rooms.window.files.get(request.path_params["name"])
        if path is None:
            return Response(status_code=404)
        return FileResponse(path, filename=path.name, media_type="application/octet-stream")

    return file


def serve(log: Path | None, host: str, port: int, announce: Callable[[str], None]) -> None:
    """Serve the studio until it is interrupted."""
    need_packages()
    import uvicorn

    from flexid.studio.guard import is_loopback

    token = "" if is_loopback(host) else secrets.token_urlsafe(32)
    listening = _listening(host, port)
    port = listening.getsockname()[1]
    app = studio(log, host, token)

    class Server(uvicorn.Server):
        async def startup(self, sockets: list[socket.socket] | None = None) -> None:
            await super().startup(sockets)
            announce(_address(host, port, token))

    config = uvicorn.Config(
        app,
        log_level="warning",
        ws_max_size=1_000_000,
        timeout_graceful_shutdown=2,
        server_header=False,
    )
    with listening:
        Server(config).run(sockets=[listening])


def _listening(host: str, port: int) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, port), family=family)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SettingError(
            "port", f"cannot listen on {host} port {port} ({reason}): give another with --port"
        ) from None


def _address(host: str, port: int, token: str) -> str:
    name = f"[{host}]" if ":" in host else host
    if host in ("0.0.0.0", "::"):
        name = socket.gethostname()
    return f"http://{name}:{port}/" + (f"?token={token}" if token else "")
