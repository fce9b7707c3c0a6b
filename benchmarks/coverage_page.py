"""Render `coverage.json` as the tables of `docs/intervals.md`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.report import markdown

RESULTS = Path(__file__).with_name("coverage.json")
PAGE = Path(__file__).parents[1] / "docs" / "intervals.md"

BLOCK = "coverage"

Cell = Mapping[str, Any]


def render(cells: Sequence[Cell]) -> str:
    """Return a table per kind of noise: coverage in percent, and width of the intervals."""
    parts: list[str] = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        chosen = [cell for cell in cells if cell["noise"] == noise]
        names = list(chosen[0]["held"])
        headings = [noise, *names, "seeds", "width"]
        parts += [*markdown(headings, [_line(cell, names) for cell in chosen]), ""]
    return "\n".join(parts)


def merged(old: Sequence[Cell], measured: Sequence[Cell]) -> tuple[list[Cell], list[Cell]]:
    """Return old cells, updated by measured ones of as many seeds, and measured ones of fewer."""
    kept = {(cell["noise"], cell["estimator"]): cell for cell in old}
    fewer = []
    for cell in measured:
        key = cell["noise"], cell["estimator"]
        if key in kept and cell["seeds"] < kept[key]["seeds"]:
            fewer.append(cell)
        else:
            kept[key] = cell
    return list(kept.values()), fewer


def _line(cell: Cell, names: Sequence[str]) -> list[str]:
    shares = [100.0 * cell["held"][name] / cell["seeds"] for name in names]
    widths = [cell["half_width_over_rms_error"][name] / 1.96 for name in names]
    return [
        cell["estimator"],
        *(f"{share:.1f}" for share in shares),
        str(cell["seeds"]),
        f"{min(widths):.2f}–{max(widths):.2f}",
    ]
