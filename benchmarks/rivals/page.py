"""Render `rivals.json` as a part of `docs/comparison.md`, without the compared tools."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from statistics import median
from textwrap import wrap
from typing import Any

from benchmarks.report import markdown
from benchmarks.rivals.tools import FAMILIES, TOOLS

RESULTS = Path(__file__).parents[1] / "rivals.json"
PAGE = Path(__file__).parents[2] / "docs" / "comparison.md"

BLOCK = "rivals"
_WIDTH = 98  # characters of a line of text

Record = Mapping[str, Any]


def render(results: Mapping[str, Any]) -> str:
    """Return all tables as Markdown."""
    records = results["records"]
    tools = [key for key in TOOLS if any(r["tool"] == key for r in records)]
    families = [f for f in FAMILIES if any(r["family"] == f for r in records)]

    def table(cell: Callable[[Sequence[Record]], str]) -> list[str]:
        lines = [
            [TOOLS[key].title, *(cell(_of(records, key, family)) for family in families)]
            for key in tools
        ]
        return markdown(["", *families], lines)

    about = [[TOOLS[key].title, results["versions"][key], TOOLS[key].given] for key in tools]
    parts = [
        "Worst relative error of gravity torque, inertias and stiffness in percent, for each log.",
        "",
        *table(_errors),
        "",
        *wrap(
            "Nominal 95 % intervals of these four that contain the truth, of all intervals; and "
            "the half-width of the widest in percent, median over the logs.",
            _WIDTH,
            break_on_hyphens=False,
        ),
        "",
        *table(_intervals),
        "",
        "Processor time for one log in s, median.",
        "",
        *table(_seconds),
        "",
        *markdown(["", "version", "given with the log"], about),
        "",
        *_failures(records),
        "Made by:",
        "",
        *(line for run in results["runs"] for line in _made(run)),
    ]
    return "\n".join(parts) + "\n"


def _made(run: Mapping[str, str]) -> list[str]:
    text = (
        f"`{run['command']}` on {run['date']}, commit {run['commit']}; {run['machine']}; "
        f"Python {run['python']}"
    )
    return wrap(text, _WIDTH, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False)


def _of(records: Sequence[Record], key: str, family: str) -> list[Record]:
    return [r for r in records if (r["tool"], r["family"]) == (key, family)]


def _errors(runs: Sequence[Record]) -> str:
    return ", ".join(
        "failed" if "failed" in run else _number(max(abs(e) for e in run["errors"].values()))
        for run in runs
    )


def _number(value: float) -> str:
    if not isfinite(value):
        return "no number"
    return f"{value:.2g}" if value < 100.0 else f"{value:.0f}"


def _intervals(runs: Sequence[Record]) -> str:
    stated = [run for run in runs if "inside" in run]
    if not stated:
        return "gives none" if any("errors" in run for run in runs) else "–"
    inside = [held for run in stated for held in run["inside"].values()]
    width = median(run["widest"] for run in stated)
    return f"{sum(inside)}/{len(inside)} ±{width:.2g}"


def _seconds(runs: Sequence[Record]) -> str:
    seconds = [run["seconds"] for run in runs if "seconds" in run]
    return _number(median(seconds)) if seconds else "–"


def _failures(records: Sequence[Record]) -> list[str]:
    failed = [
        f"- {TOOLS[r['tool']].title}, {r['family']} {r['seed']}: {r['failed']}"
        for r in records
        if "failed" in r
    ]
    return ["Failed:", "", *failed, ""] if failed else []
