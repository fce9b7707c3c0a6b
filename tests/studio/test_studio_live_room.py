"""Live in a window without a browser: what starts, pauses and ends a stream."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from flexid.studio import live_jobs, live_room
from flexid.studio.rooms import Rooms
from flexid.studio.window import Offer, Window
from flexid.studio.workers import Workers

Message = dict[str, Any]


def streams(_: Callable[[str], None]) -> int:
    """How many streams the process keeps."""
    return len(live_jobs._STREAMS)


class Page:
    """What a window's page gets to see."""

    def __init__(self, offer: Offer) -> None:
        self.got: asyncio.Queue[Message] = asyncio.Queue()
        self.rooms = Rooms(Window(offer, self.got.put))

    async def ask(self, kind: str, **more: Any) -> None:
        """Ask for something."""
        await self.rooms.handle({"kind": kind, **more})

    async def until(self, words: str) -> str:
        """Wait for a message that holds some words; return it."""
        while True:
            text = str(await self.got.get())
            if words in text:
                return text


@asynccontextmanager
async def studio(log: Path | None = None) -> AsyncIterator[Offer]:
    """Processes for windows; those that no test needs are never started."""
    processes = [Workers(1) for _ in range(4)]
    try:
        yield Offer(log, *processes)
    finally:
        for workers in processes:
            workers.end()


async def kept(offer: Offer) -> int:
    """How many streams there are, after all that was asked for before."""
    work = offer.live.run(streams, folder=Path.cwd(), said=print)
    return await asyncio.create_task(work)


def test_a_window_that_closes_ends_its_stream():
    """Assert that two windows have one each, that stop ends one, and closing the other."""

    async def main() -> None:
        async with studio() as offer:
            pages = [Page(offer), Page(offer)]
            for page in pages:
                await page.ask("room", target="live")
                await page.ask("live-start")
                await page.ask("live-start")
                await page.until("'live-charts'")
                await page.until("Running")
            assert await kept(offer) == 2
            await pages[0].ask("live-stop")
            assert await kept(offer) == 1
            await pages[1].rooms.close()
            assert await kept(offer) == 0
            assert not pages[1].rooms.window.folder.exists()
            await pages[0].rooms.close()

    asyncio.run(main())


def test_pause_keeps_the_stream_and_start_goes_on():
    """Assert that nothing comes in meanwhile, and that the clock goes on after it."""

    async def main() -> None:
        async with studio() as offer:
            page = Page(offer)
            await page.ask("open", values={"room": "live", "pace": "16"})
            await page.ask("live-start")
            await page.until("Running: 16.0 s")
            await page.ask("live-pause")
            await page.until("Paused")
            assert await kept(offer) == 1
            await page.ask("live-start")
            text = await page.until("Running")
            assert "Running: 8.0 s" not in text
            await page.ask("live", values={"source": "replay"})
            await page.until("flexid studio LOG")
            await page.until("Running")
            await page.rooms.close()

    asyncio.run(main())


def test_a_log_that_is_no_stream_is_said_and_can_be_left(tmp_path: Path, monkeypatch: Any):
    """Assert that its error is shown, and that the simulated drive runs after it."""
    log = tmp_path / "words.csv"
    log.write_text("<script>,b\n" + "x,y\n" * 300)
    monkeypatch.setattr(live_room, "TURN", 0.0)

    async def main() -> None:
        async with studio(log) as offer:
            page = Page(offer)
            await page.ask("room", target="live")
            await page.ask("live", values={"source": "replay", "pace": "1"})
            await page.ask("live-start")
            text = await page.until("This cannot be used")
            assert "words.csv" in text
            assert str(tmp_path) not in text
            assert "<script>" not in text
            assert await kept(offer) == 0
            await page.ask("live", values={"source": "drive", "pace": "1"})
            await page.ask("live-start")
            await page.until("Converged")
            await page.rooms.close()

    asyncio.run(main())
