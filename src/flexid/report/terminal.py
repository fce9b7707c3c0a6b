"""How answers are printed: at most 100 columns wide."""

from collections.abc import Iterable

from rich.console import Console, Group, RenderableType

WIDTH = 100
"""Columns that an answer fits in; also its width where there is no terminal to ask."""

NARROWEST = 80
"""Columns below which a terminal breaks the lines itself, lest numbers be cut off."""


def print_parts(parts: Iterable[RenderableType]) -> None:
    """Print tables and texts on standard output, one after the other."""
    console = Console()
    width = min(max(console.width, NARROWEST), WIDTH) if console.is_terminal else WIDTH
    Console(width=width).print(Group(*parts))
