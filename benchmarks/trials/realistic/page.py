"""Table of the scores of realistic trials."""

from collections.abc import Callable, Mapping, Sequence
from textwrap import wrap
from typing import Any

from benchmarks.report import markdown
from benchmarks.trials import cells
from benchmarks.trials.realistic.families import REALISTIC
from benchmarks.trials.realistic.score import RealisticScore, claims, scores

TITLE = "Realistic drives"

_ABOUT = (
    "Share of determined intervals that contain the truth, of all parameters and of the core: "
    "inertias and stiffness, or their ratios. Half-width of determined core intervals, relative to "
    "the truth, median. Error ratio: spread of the errors of determined core parameters over their "
    "standard errors; above 1 the intervals are too narrow. Wrong: logs with a determined "
    "core parameter outside its interval and more than 5 % off. Seconds of processor time: median "
    "/ largest."
)

_COLUMNS: Sequence[tuple[str, Callable[[RealisticScore], str]]] = (
    ("logs", lambda one: str(one.logs)),
    ("no result", lambda one: cells.failures(one.failed, one.refused)),
    ("determined", lambda one: cells.share(one.determined)),
    ("determined core", lambda one: cells.share(one.core)),
    ("core determined", lambda one: cells.share(one.core_determined)),
    ("half-width (%)", lambda one: cells.percent(one.half_width)),
    ("error ratio", lambda one: cells.number(one.error_ratio)),
    ("wrong", lambda one: cells.share(one.wrong)),
    ("seconds", lambda one: cells.seconds(one.seconds)),
)

Records = Sequence[Mapping[str, Any]]


def table(records: Records) -> tuple[list[str], list[list[str]]]:
    """Return the headings and a line for each family."""
    lines = [[one.family, *(cell(one) for _, cell in _COLUMNS)] for one in scores(records)]
    return [TITLE.lower(), *(name for name, _ in _COLUMNS)], lines


def render(records: Records) -> list[str]:
    """Return the section of the page."""
    parts = [f"### {TITLE}", "", *wrap(_ABOUT, 98), "", *markdown(*table(records)), ""]
    parts += ["### Each realistic core parameter outside its interval", ""]
    lines = _outside(records)
    headings = ["family", "seed", "parameter", "truth", "value", "interval"]
    return [*parts, *(markdown(headings, lines) if lines else ["None."]), ""]


def families() -> str:
    """Return the list of families as Markdown."""
    return "\n".join(
        markdown(["family", "properties"], [[one.name, one.about] for one in REALISTIC.values()])
    )


def _outside(records: Records) -> list[list[str]]:
    return [
        [
            record["family"],
            str(record["seed"]),
            claim.name,
            f"{claim.truth:.5g}",
            f"{claim.value:.5g}",
            f"{claim.low:.5g} to {claim.high:.5g}",
        ]
        for record in records
        for claim in claims(record)
        if claim.name in record["core"] and claim.status == "determined" and not claim.holds
    ]
