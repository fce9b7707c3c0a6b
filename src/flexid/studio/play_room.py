"""Play: the paper's closed loop with sliders, beside a pinned run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from flexid.errors import FlexidError
from flexid.studio.play_choices import READINGS, SLIDERS, TABLE1, PlayChoices, query_of, read_play
from flexid.studio.play_jobs import PlayedRuns, play

if TYPE_CHECKING:
    from flexid.studio.window import Window

ROOM = "play"


class PlayRoom:
    """The room of one window."""

    def __init__(self, window: Window) -> None:
        self._window = window
        self._chosen = TABLE1
        self._pinned: PlayChoices | None = TABLE1
        self._is_open = False
        self._refused = ""  # why an address cannot be used; stands until something is chosen

    async def open(self, values: Mapping[str, object]) -> None:
        """Begin with what an address holds."""
        try:
            chosen = read_play(values)
            pinned = None if values.get("pin") == "none" else read_play(values, "pin.")
        except FlexidError as error:
            self._refused = str(error)
        else:
            self._chosen, self._pinned = chosen, pinned

    async def enter(self) -> None:
        """Show the room."""
        if not self._is_open:
            self._is_open = True
            await self._show_controls()
        await self._start()

    async def change(self, values: object) -> None:
        """Play what the sliders stand at."""
        self._refused = ""
        try:
            self._chosen = read_play(values)
        except FlexidError as error:
            await self._window.show("play-problem", "problem.html", text=str(error))
            await self._window.played()
            return
        await self._start()

    async def pin(self) -> None:
        """Keep the present run to compare with."""
        self._pinned = self._chosen
        await self._start()

    async def unpin(self) -> None:
        """Show the present run alone."""
        self._pinned = None
        await self._start()

    async def reset(self) -> None:
        """Go back to Table I."""
        self._refused = ""
        self._chosen = self._pinned = TABLE1
        await self._show_controls()
        await self._start()

    async def _show_controls(self) -> None:
        groups: dict[str, list[object]] = {}
        for slider in SLIDERS:
            groups.setdefault(slider.group, []).append(slider)
        show, chosen = self._window.show, self._chosen
        await show("play-readings", "play_readings.html", chosen=chosen, readings=READINGS)
        await show("play-controls", "play_controls.html", chosen=chosen, groups=groups)

    async def _start(self) -> None:
        await self._window.address(ROOM, query_of(self._chosen, self._pinned))
        self._window.start("play", self._play(), "play-problem")

    async def _play(self) -> None:
        try:
            await self._show_run()
        except Exception:
            await self._window.played()  # the page waits for it before it asks again
            raise
        await self._window.played()

    async def _show_run(self) -> None:
        window = self._window
        found: PlayedRuns = await window.brief(
            window.offer.play, play, self._chosen, self._pinned, window.kind, place="play-line"
        )
        problems = (self._refused, *found.problems) if self._refused else found.problems
        await window.show("play-problem", "play_problems.html", problems=problems)
        await window.show("play-figures", "play_figures.html", found=found)
        await window.show("play-charts", "figures.html", figures=(found.figure,))
