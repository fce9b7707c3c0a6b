"""`coverage.json` as the tables of `docs/coverage.md`."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.report import markdown

RESULTS = Path(__file__).with_name("coverage.json")
PAGE = Path(__file__).parents[1] / "docs" / "coverage.md"

BEGIN, END = "<!-- coverage: begin -->", "<!-- coverage: end -->"

Cell = Mapping[str, Any]


def with_block(page: str, block: str) -> str:
    """The page with what stands between its two marks replaced.

    Raises
    ------
    ValueError
        If the page does not have both marks once.
    """
    if page.count(BEGIN) != 1 or page.count(END) != 1:
        raise ValueError(f"the page does not have {BEGIN} and {END} once each: write them")
    before, _, rest = page.partition(BEGIN)
    return f"{before}{BEGIN}\n\n{block}\n{END}{rest.partition(END)[2]}"


def block_of(page: str) -> str:
    """What stands between the two marks."""
    return page.partition(f"{BEGIN}\n\n")[2].partition(f"\n{END}")[0]


def render(cells: Sequence[Cell]) -> str:
    """One table per kind of noise, coverage in percent with the width of the intervals."""
    parts: list[str] = []
    for noise in dict.fromkeys(cell["noise"] for cell in cells):
        chosen = [cell for cell in cells if cell["noise"] == noise]
        names = list(chosen[0]["held"])
        headings = [noise, *names, "seeds", "width"]
        parts += [*markdown(headings, [_line(cell, names) for cell in chosen]), ""]
    return "\n".join(parts)


def _line(cell: Cell, names: Sequence[str]) -> list[str]:
    shares = [100.0 * cell["held"][name] / cell["seeds"] for name in names]
    widths = [cell["half_width_over_rms_error"][name] / 1.96 for name in names]
    return [
        cell["estimator"],
        *(f"{share:.1f}" for share in shares),
        str(cell["seeds"]),
        f"{min(widths):.2f}–{max(widths):.2f}",
    ]
