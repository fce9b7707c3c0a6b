"""How answers are printed: at most 100 columns wide."""

from collections.abc import Iterable

from rich import box
from rich.console import Console, Group, RenderableType
from rich.table import Table

WIDTH = 100
"""Columns that an answer fits in; also its width where there is no terminal to ask."""

NARROWEST = 80
"""Columns below which a terminal breaks the lines itself, lest numbers be cut off."""


def titled_table(title: str, collapse_padding: bool = False) -> Table:
    """An empty table with its title above it on the left; the columns close together if wanted."""
    return Table(
        title=title,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        collapse_padding=collapse_padding,
    )


def print_parts(parts: Iterable[RenderableType]) -> None:
    """Print tables and texts on standard output, one after the other."""
    console = Console()
    width = min(max(console.width, NARROWEST), WIDTH) if console.is_terminal else WIDTH
    Console(width=width).print(Group(*parts))
