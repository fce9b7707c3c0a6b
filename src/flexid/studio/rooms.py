"""The rooms of one window, and what its page may ask of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.errors import FlexidError
from flexid.studio import identify_room, play_room
from flexid.studio.identify_room import IdentifyRoom
from flexid.studio.play_room import PlayRoom

if TYPE_CHECKING:
    from flexid.studio.window import Window


class Rooms:
    """The rooms of one window."""

    def __init__(self, window: Window) -> None:
        self.window = window
        self._identify = IdentifyRoom(window)
        self._play = PlayRoom(window)

    async def handle(self, request: Mapping[str, object]) -> None:
        """Do what the page asks for; what is not known is not done."""
        values, target = request.get("values"), request.get("target")
        self.window.kind = "narrow" if request.get("narrow") is True else "wide"
        try:
            match request.get("kind"):
                case "open":
                    await self._open(values)
                case "room":
                    await self._enter(target)
                case "columns":
                    await self._identify.choose(values)
                case "settings":
                    await self._identify.settle(values)
                case "run":
                    await self._identify.run(values)
                case "cancel":
                    await self._identify.cancel()
                case "export":
                    self._identify.export(target)
                case "play":
                    await self._play.change(values)
                case "pin":
                    await self._play.pin()
                case "unpin":
                    await self._play.unpin()
                case "reset":
                    await self._play.reset()
                case _:
                    pass
        except FlexidError:
            pass  # it has been shown

    async def _open(self, values: object) -> None:
        """Begin with what an address holds; what cannot be used of it is said in its room."""
        await self.window.opened()
        await self._identify.open(values)
        room = values.get("room") if isinstance(values, Mapping) else None
        if isinstance(values, Mapping) and room == play_room.ROOM:
            await self._play.open(values)
        await self._enter(room)

    async def _enter(self, room: object) -> None:
        known = play_room.ROOM if room == play_room.ROOM else identify_room.ROOM
        await self.window.enter(known)
        await (self._play if known == play_room.ROOM else self._identify).enter()

    def uploaded(self, path: Path) -> None:
        """Go on with a log that was sent."""
        self._identify.uploaded(path)

    async def close(self) -> None:
        """End what runs for the window, and forget what it holds."""
        await self.window.close()
