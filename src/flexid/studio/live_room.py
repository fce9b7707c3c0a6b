"""Live: estimates that converge from a stream, with their health."""

from __future__ import annotations

import asyncio
from collections import deque
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from flexid.errors import FlexidError
from flexid.streaming.incoming import is_whole_log
from flexid.studio import live_jobs
from flexid.studio.choices import Choices
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
    from flexid.studio.identify_room import IdentifyRoom
    from flexid.studio.window import Window

ROOM = "live"
TURN = 0.5
"""Seconds between two pieces."""

_MOST_EVENTS = 8  # changes of the health that are listed


@dataclass(frozen=True)
class _Request:
    """What a stream is begun with.

    Parameters
    ----------
    source : str
        Where samples come from.
    log : Path
        The log; of no matter where the drive is simulated.
    choices : Choices
        How it is read and modelled.
    """

    source: str
    log: Path
    choices: Choices


class LiveRoom:
    """The room of one window.

    Parameters
    ----------
    window : Window
        What it shows.
    identify : IdentifyRoom
        Whose log it may watch, read as it is there.
    """

    def __init__(self, window: Window, identify: IdentifyRoom) -> None:
        self._window = window
        self._identify = identify
        self._chosen = LiveChoices()
        self._begun: _Request | None = None
        self._running = False
        self._health = ""
        self._events: deque[tuple[float, str, str]] = deque(maxlen=_MOST_EVENTS)

    async def open(self, values: object) -> None:
        """Begin with what an address holds."""
        try:
            self._chosen = read_live(values, self._sources)
        except FlexidError as error:
            await self._window.show("live-problem", "problem.html", text=str(error))

    @property
    def _sources(self) -> tuple[str, ...]:
        """What samples may come from: a log, which one can follow where it can grow."""
        log = self._identify.log
        if log is None:
            return (DRIVE,)
        grows = log == self._window.offer.log and not is_whole_log(str(log))
        return (DRIVE, REPLAY, FOLLOW) if grows else (DRIVE, REPLAY)

    @property
    def _request(self) -> _Request:
        """What a stream is begun with."""
        source, log = self._chosen.source, self._identify.log
        if source == DRIVE or log is None:
            return _Request(DRIVE, Path.cwd() / DRIVE, Choices())
        return _Request(source, log, self._identify.choices.asked)

    @property
    def _query(self) -> str:
        """The end of an address that shows the room so."""
        pairs = self._chosen.query, self._request.choices.query
        return "&".join(filter(None, pairs))

    async def enter(self) -> None:
        """Show the room, as it is with what Identify holds by now."""
        if self._chosen.source not in self._sources:
            self._chosen = replace(self._chosen, source=DRIVE)
        if self._begun is not None and self._begun != self._request:
            await self.stop()
            await self._say("The log was chosen or read otherwise: Start begins anew.")
        log = self._identify.log
        await self._window.show(
            "live-controls", "live_controls.html", chosen=self._chosen, paces=PACES,
            sources={name: SOURCES[name] for name in self._sources},
            log="" if log is None else log.name, problem=self._identify.problem,
        )  # fmt: skip
        await self._window.address(ROOM, self._query)

    def renewed(self) -> None:
        """Go on with another log of Identify."""
        self._window.start("live-renewed", self.enter(), "live-problem")

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
        await self._window.address(ROOM, self._query)

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
        if self._begun is not None:
            self._forget()
            await self._say("Stopped: Start begins anew.")

    def close(self) -> None:
        """End the stream of a window that is gone."""
        if self._begun is not None:
            self._forget()

    def _forget(self) -> None:
        self._begun = None
        window = self._window
        work = asyncio.ensure_future(
            window.offer.live.run(
                live_jobs.forget, window.key, folder=Path.cwd(), said=lambda _: None
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
        if self._begun is not None:
            return
        self._begun = request = self._request
        self._health = ""
        self._events.clear()
        window = self._window
        for place in ("problem", "health", "events", "table", "more"):
            await window.show(f"live-{place}", "nothing.html")
        await window.draw("live-charts", ())
        await self._say("Starting (the first run on a machine compiles for up to a minute) ...")
        await window.brief(
            window.offer.live, live_jobs.begin, window.key, request.source, request.log.name,
            request.choices, place="live-line", folder=request.log.absolute().parent,
        )  # fmt: skip

    async def _turn(self) -> bool:
        """Take in a piece, and show what is known; return whether it was the last."""
        window, begun = self._window, self._begun
        assert begun is not None
        seen: live_jobs.Seen | None = await window.brief(
            window.offer.live, live_jobs.go_on, window.key, self._chosen,
            place="live-line", folder=begun.log.absolute().parent,
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
