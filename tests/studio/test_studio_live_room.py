"""Live in a window without a browser: what starts, pauses and ends a stream."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from flexid.studio import live_jobs, live_room
from flexid.studio.live_drive import SimulatedDrive
from flexid.studio.rooms import Rooms
from flexid.studio.window import Offer, Window
from flexid.studio.workers import Workers

Message = dict[str, Any]
PATIENCE = 120.0  # s, in which a kernel may have to be compiled


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
        async with asyncio.timeout(PATIENCE):
            while words not in (text := str(await self.got.get())):
                pass
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


def raw_log(folder: Path) -> Path:
    """A log in degrees and milliseconds, whose names do not say what it holds."""
    path = folder / "raw.csv"
    drive = SimulatedDrive()
    pieces = [drive.piece(loaded=False, unplugged=False) for _ in range(8)]
    scaled = np.vstack(pieces) * [1e3, 180 / np.pi, 180 / np.pi, 1.0]
    rows = (",".join(f"{value:.9g}" for value in row) for row in scaled)
    path.write_text("\n".join(["a,b,c,d", *rows]) + "\n")
    return path


RAW = {
    "time": ("a", "ms"),
    "link_position": ("b", "deg"),
    "motor_position": ("c", "deg"),
    "motor_torque": ("d", "N m"),
}


def test_a_log_that_was_sent_and_mapped_is_watched(monkeypatch: pytest.MonkeyPatch):
    """Assert that Live reads it as Identify does: columns, units, terms; and ends it with them."""
    monkeypatch.setattr(live_room, "TURN", 0.0)
    values = {"terms": "gravity,motor_viscous"}
    for channel, (column, unit) in RAW.items():
        values |= {f"column.{channel}": column, f"unit.{channel}": unit}

    async def main() -> None:
        async with studio() as offer:
            page = Page(offer)
            page.rooms.uploaded(raw_log(page.rooms.window.folder))
            await page.until("raw.csv</strong>")
            await page.ask("columns", values=values)
            await page.until("check-charts")
            await page.ask("room", target="live")
            assert "followed" not in await page.until("the log, played again (raw.csv)")
            await page.ask("live", values={"source": "replay", "pace": "16"})
            await page.until("unit.motor_position=deg")
            await page.ask("live-start")
            text = await page.until("Joint stiffness".lower())
            assert "damping" not in text
            value = re.search(r"joint stiffness</th><td[^>]*>([\d.]+)", text)
            assert value is not None
            assert float(value[1]) == pytest.approx(100.0, rel=0.05)
            await page.until("at its end")

            await page.ask("live-start")
            await page.until("Running")
            await page.ask("live-pause")
            await page.ask("room", target="identify")
            await page.ask("settings", values={**values, "terms": "gravity"})
            assert await kept(offer) == 1
            await page.ask("room", target="live")
            await page.until("read otherwise")
            assert await kept(offer) == 0
            await page.rooms.close()

    asyncio.run(main())


def test_another_log_ends_the_stream_of_the_one_before(monkeypatch: pytest.MonkeyPatch):
    """Assert that a log that is sent while another is watched takes its place in Live."""
    monkeypatch.setattr(live_room, "TURN", 0.0)

    async def main() -> None:
        async with studio() as offer:
            page = Page(offer)
            folder = page.rooms.window.folder
            log = raw_log(folder)
            named = "time [ms],link_position [deg],motor_position [deg],motor_torque"
            log.write_text(log.read_text().replace("a,b,c,d", named))
            other = log.with_name("other.csv")
            other.write_text(log.read_text())
            page.rooms.uploaded(log)
            await page.ask("room", target="live")
            await page.ask("live", values={"source": "replay", "pace": "1"})
            await page.ask("live-start")
            await page.until("Running")
            page.rooms.uploaded(other)
            await page.until("the log, played again (other.csv)")
            assert await kept(offer) == 0
            await page.ask("live-start")
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
            await page.ask("open", values={"room": "live"})
            await page.ask("live", values={"source": "replay", "pace": "1"})
            await page.ask("live-start")
            text = await page.until("'live-problem', 'html': '<p class=")
            assert "words.csv" in text
            assert str(tmp_path) not in text
            assert "<script>" not in text
            assert await kept(offer) == 0
            await page.ask("live", values={"source": "drive", "pace": "1"})
            await page.ask("live-start")
            await page.until("Converged")
            await page.rooms.close()

    asyncio.run(main())
