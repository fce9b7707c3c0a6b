"""One window of the studio: its files, tasks, messages to the page, and rooms."""

import asyncio
import secrets
import shutil
import tempfile
from collections.abc import Awaitable, Callable, Coroutine, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from flexid.errors import FlexidError
from flexid.report.page import drawing_style, page_environment
from flexid.studio import play
from flexid.studio.identify_room import IdentifyRoom
from flexid.studio.jobs import Workers
from flexid.studio.play import PlayRoom

_ASSETS = {"studio.css": "text/css", "studio.js": "text/javascript"}


_PAGE = Path(__file__).parent / "page"


def fragment(template: str, **content: Any) -> str:
    """Render a part of the page as HTML."""
    return page_environment(_PAGE).get_template(template).render(content)


@cache
def assets() -> dict[str, tuple[bytes, str]]:
    """Return the scripts and style sheets by name, with their media types."""
    own = {name: ((_PAGE / name).read_bytes(), kind) for name, kind in _ASSETS.items()}
    return {**own, "chart.css": (drawing_style().encode(), "text/css")}


Send = Callable[[dict[str, Any]], Awaitable[None]]  # sends a message to the page of a window


@dataclass(frozen=True)
class Offer:
    """Resources that all windows share."""

    log: Path | None  # from the command line
    long: Workers
    short: Workers
    play: Workers


class Window:
    """One window: its folder, its running tasks and the connection to its page."""

    def __init__(self, offer: Offer, send: Send) -> None:
        self.offer = offer
        self.key = secrets.token_urlsafe(16)
        self.folder = Path(tempfile.mkdtemp(prefix="flexid-studio-"))
        self.files: dict[str, Path] = {}
        self._send = send
        self._tasks: dict[str, asyncio.Task[None]] = {}
        self._alive: set[asyncio.Task[None]] = set()

    async def tell(self, kind: str, **content: str) -> None:
        """Send the page a message of a kind that its script knows."""
        await self._send({"kind": kind, **content})

    async def show(self, place: str, template: str, **content: Any) -> None:
        """Fill a place of the page with a rendered template."""
        html = fragment(template, window=self.key, **content)
        await self.tell("show", place=place, html=html)

    async def brief(self, workers: Workers, job: Callable[..., Any], *arguments: Any) -> Any:
        """Run a short job, which is not interrupted if the caller is cancelled."""
        work = asyncio.ensure_future(workers.run(job, *arguments, folder=self.folder))
        work.add_done_callback(lambda done: done.cancelled() or done.exception())
        return await asyncio.shield(work)

    def start(self, name: str, work: Coroutine[Any, Any, None], place: str) -> None:
        """Start a task, cancel the previous one of that name, and show errors in a place."""
        self.cancel(name)
        self._tasks[name] = task = asyncio.create_task(self._guarded(work, place))
        self._alive.add(task)
        task.add_done_callback(self._alive.discard)
        task.add_done_callback(lambda _: work.close())  # for a task cancelled before it started

    def cancel(self, name: str) -> bool:
        """Cancel the task of a name; return whether one was running."""
        task = self._tasks.pop(name, None)
        return task is not None and task.cancel()

    async def _guarded(self, work: Coroutine[Any, Any, None], place: str) -> None:
        try:
            await work
        except FlexidError as error:
            await self.show(place, "problem.html", text=str(error))
        except Exception as error:  # an unforeseen error must not leave the page waiting
            text = f"a defect of flexid ({type(error).__name__}: {error})"
            await self.show(place, "problem.html", text=text)

    async def close(self) -> None:
        """Cancel all tasks and then delete the window's files."""
        try:
            for task in self._alive:
                task.cancel()
            await asyncio.gather(*self._alive, return_exceptions=True)
        finally:
            shutil.rmtree(self.folder, ignore_errors=True)


class Rooms:
    """Rooms of one window, and its requests."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self.identify, self.play = IdentifyRoom(window), PlayRoom(window)

    async def handle(self, request: Mapping[str, object]) -> None:
        """Handle a request of the page; an unknown one is ignored."""
        name = f"on_{request.get('kind')}"
        for room in (self, self.identify, self.play):
            if (answer := getattr(room, name, None)) is not None:
                with suppress(FlexidError):  # the page already shows it
                    await answer(request.get("values"), request.get("target"))

    async def on_open(self, values: object, _target: object) -> None:
        """Open the rooms with the values in an address; each room shows errors in its own."""
        await self.window.tell("opened", key=self.window.key)  # with which it may upload a log
        await self.identify.open(values)
        room = values.get("room") if isinstance(values, Mapping) else None
        if isinstance(values, Mapping) and room == play.ROOM:
            self.play.open(values)
        await self.on_room(None, room)

    async def on_room(self, _values: object, room: object) -> None:
        """Switch to a room."""
        known = play.ROOM if room == play.ROOM else "identify"
        await self.window.tell("room", room=known)
        if known == play.ROOM:
            await self.play.enter()
