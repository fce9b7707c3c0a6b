"""Live: estimates that converge from a stream, with their health."""

from __future__ import annotations

import asyncio
from collections import deque
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from flexid.errors import FlexidError
from flexid.streaming.incoming import is_whole_log
from flexid.studio import live_jobs
from flexid.studio.live_choices import (
    DRIVE,
    FOLLOW,
    PACES,
    REPLAY,
    SOURCES,
    LiveChoices,
    read_live,
)

if TYPE_CHECKING:
    from flexid.studio.window import Window

ROOM = "live"
TURN = 0.5
"""Seconds between two pieces."""

_MOST_EVENTS = 8  # changes of the health that are listed


class LiveRoom:
    """The room of one window.

    Parameters
    ----------
    window : Window
        What it shows.
    """

    def __init__(self, window: Window) -> None:
        self._window = window
        log = window.offer.log
        self._log = "" if log is None else log.name
        self._folder = Path.cwd() if log is None else log.parent
        self._sources = _sources(log)
        self._chosen = LiveChoices()
        self._is_open = False
        self._begun = False
        self._running = False
        self._health = ""
        self._events: deque[tuple[float, str, str]] = deque(maxlen=_MOST_EVENTS)

    async def open(self, values: object) -> None:
        """Begin with what an address holds."""
        try:
            self._chosen = read_live(values, self._sources)
        except FlexidError as error:
            await self._window.show("live-problem", "problem.html", text=str(error))

    async def enter(self) -> None:
        """Show the room."""
        if not self._is_open:
            self._is_open = True
            sources = {name: SOURCES[name] for name in self._sources}
            await self._window.show(
                "live-controls", "live_controls.html", chosen=self._chosen, sources=sources,
                paces=PACES, log=self._log,
            )  # fmt: skip
        await self._window.address(ROOM, self._chosen.query)

    async def change(self, values: object) -> None:
        """Take what the form holds; it holds from the next piece on."""
        try:
            chosen = read_live(values, self._sources)
        except FlexidError as error:
            await self._window.show("live-problem", "problem.html", text=str(error))
            return
        if chosen.source != self._chosen.source:
            await self.stop()
        self._chosen = chosen
        await self._window.address(ROOM, chosen.query)

    async def start(self) -> None:
        """Begin the stream, or go on with it."""
        if not self._running:
            self._running = True
            self._window.start(ROOM, self._run(), "live-problem")

    async def pause(self) -> None:
        """Wait with what is known."""
        if self._running:
            self._running = False
            self._window.cancel(ROOM)
            await self._say("Paused: Start goes on.")

    async def stop(self) -> None:
        """End the stream; what was shown stays."""
        self._running = False
        self._window.cancel(ROOM)
        if self._begun:
            self._forget()
            await self._say("Stopped: Start begins anew.")

    def close(self) -> None:
        """End the stream of a window that is gone."""
        if self._begun:
            self._forget()

    def _forget(self) -> None:
        self._begun = False
        window = self._window
        work = asyncio.ensure_future(
            window.offer.live.run(
                live_jobs.forget, window.key, folder=self._folder, said=lambda _: None
            )
        )
        work.add_done_callback(lambda done: done.cancelled() or done.exception())

    async def _run(self) -> None:
        """Take in a piece every half second."""
        try:
            await self._begin()
            ended = False
            while not ended:
                turned = monotonic()
                ended = await self._turn()
                await asyncio.sleep(max(0.0, turned + TURN - monotonic()))
        except Exception:
            self._running = False
            self._forget()
            await self._say("")
            raise
        self._running = False
        self._forget()
        await self._say("The log is at its end: Start begins anew.")

    async def _begin(self) -> None:
        if self._begun:
            return
        self._begun = True
        self._health = ""
        self._events.clear()
        window = self._window
        for place in ("problem", "health", "events", "table", "more"):
            await window.show(f"live-{place}", "nothing.html")
        await window.draw("live-charts", ())
        await self._say("Starting (the first run on a machine compiles for up to a minute) ...")
        await window.brief(
            window.offer.live, live_jobs.begin, window.key, self._chosen.source, self._log,
            place="live-line", folder=self._folder,
        )  # fmt: skip

    async def _turn(self) -> bool:
        """Take in a piece, and show what is known; return whether it was the last."""
        window = self._window
        seen: live_jobs.Seen | None = await window.brief(
            window.offer.live, live_jobs.go_on, window.key, self._chosen,
            place="live-line", folder=self._folder,
        )  # fmt: skip
        if seen is None:
            await self._say("Waiting for samples ...")
            return False
        await self._say(f"Running: {seen.time:.1f} s of the stream.")
        await window.show("live-health", "live_health.html", seen=seen)
        if seen.health != self._health:
            self._health = seen.health
            self._events.appendleft((seen.time, seen.health, seen.tone))
            await window.show("live-events", "live_events.html", events=self._events)
        await window.show("live-table", "live_table.html", seen=seen)
        await window.show("live-more", "live_more.html", seen=seen)
        await window.draw("live-charts", (seen.chart,))
        return seen.ended

    async def _say(self, text: str) -> None:
        self._window.saying("live-line")(text)


def _sources(log: Path | None) -> tuple[str, ...]:
    """What samples may come from: with a log it may be that, and follow it where it can grow."""
    if log is None:
        return (DRIVE,)
    return (DRIVE, REPLAY) if is_whole_log(str(log)) else (DRIVE, REPLAY, FOLLOW)
