"""One look for all figures, and the way they are saved."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
from matplotlib.figure import Figure

from flexid.report.charts.description import VERDICT_COLOURS, Colour

if TYPE_CHECKING:
    from matplotlib.typing import RcKeyType

INK, BLUE, ORANGE, GREEN, RED, GREY = (
    "#1b1f24",
    "#1f6fb4",
    "#d9730d",
    "#2e8b57",
    "#c0392b",
    "#8a939c",
)
GRID = "#e3e6e9"

COLOURS: Mapping[Colour, str] = {
    "ink": INK,
    "blue": BLUE,
    "orange": ORANGE,
    "green": GREEN,
    "red": RED,
    "grey": GREY,
}
"""The shade of each colour of a chart."""

STATUS_COLOURS = {verdict: COLOURS[colour] for verdict, colour in VERDICT_COLOURS.items()}
"""Colour of each verdict in a figure or a table."""

STYLE: dict[RcKeyType, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8,
    "lines.linewidth": 1.3,
    "figure.dpi": 100,
    "savefig.dpi": 200,
    "figure.constrained_layout.use": True,
    "pdf.fonttype": 42,
}


class NotebookFigure(Figure):
    """A figure that a notebook shows although pyplot does not know it."""

    def _repr_png_(self) -> bytes:
        with io.BytesIO() as file:
            self.savefig(file, format="png", dpi=self.dpi)
            return file.getvalue()


def new_figure(width: float = 7.2, height: float = 4.5) -> Figure:
    """Figure in inches with the common look; needs no display."""
    with mpl.rc_context(STYLE):
        return NotebookFigure(figsize=(width, height))


def save(figure: Figure, directory: Path, name: str, formats: Sequence[str] = ("png",)) -> None:
    """Write the figure as ``directory/name.format`` for each format."""
    with mpl.rc_context(STYLE):
        for extension in formats:
            # Without a date the same result gives the same file
            metadata = {"CreationDate": None} if extension == "pdf" else None
            figure.savefig(directory / f"{name}.{extension}", metadata=metadata)
            figure.set_layout_engine("none")  # laid out once, the same for every format
