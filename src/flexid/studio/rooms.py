"""The rooms of one window, and what its page may ask of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.errors import FlexidError
from flexid.studio.identify_room import IdentifyRoom

if TYPE_CHECKING:
    from flexid.studio.window import Window


class Rooms:
    """The rooms of one window.

    Parameters
    ----------
    window : Window
        What they share.
    """

    def __init__(self, window: Window) -> None:
        self.window = window
        self._identify = IdentifyRoom(window)

    async def handle(self, request: Mapping[str, object]) -> None:
        """Do what the page asks for; what is not known is not done."""
        values = request.get("values")
        try:
            match request.get("kind"):
                case "open":
                    await self.window.opened()
                    await self._identify.open(values)
                case "columns" | "settings":
                    await self._identify.choose(values)
                case "run":
                    await self._identify.run(values)
                case "cancel":
                    await self._identify.cancel()
                case "export":
                    self._identify.export(request.get("target"))
                case _:
                    pass
        except FlexidError:
            pass  # it has been shown

    def uploaded(self, path: Path) -> None:
        """Go on with a log that was sent."""
        self._identify.uploaded(path)
