"""Render `accuracy.json` as the tables of `docs/comparison.md`, without the compared tools."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from textwrap import wrap
from typing import Any

from benchmarks.accuracy_tools import TOOLS
from benchmarks.report import markdown

RESULTS = Path(__file__).with_name("accuracy.json")
PAGE = Path(__file__).parents[1] / "docs" / "comparison.md"

BLOCK = "accuracy"
_WIDTH = 98  # characters of a line of text
_CODE_BEGINS, _CODE_ENDS = "# user code begins", "# user code ends"

_SAME_DATA = "encoders, noise × 1"  # where all tools have the same data

Run = Mapping[str, Any]


def lines_of_user_code(source: Path) -> int:
    """Count the lines between the two marks, without blank lines and comments.

    Raises
    ------
    ValueError
        If the file does not contain both marks once, in this order.
    """
    lines = [line.strip() for line in source.read_text(encoding="utf-8").splitlines()]
    if lines.count(_CODE_BEGINS) != 1 or lines.count(_CODE_ENDS) != 1:
        raise ValueError(f"{source} does not mark its user's code once: write both marks")
    code = lines[lines.index(_CODE_BEGINS) + 1 : lines.index(_CODE_ENDS)]
    return sum(1 for line in code if line and not line.startswith("#"))


def render(results: Mapping[str, Any]) -> str:
    """Return all tables as Markdown."""
    tools = {tool.key: tool for tool in TOOLS if tool.key in results["tools"]}
    found = {key: results["tools"][key] for key in tools}
    cases = list(dict.fromkeys(run["case"] for entry in found.values() for run in entry["runs"]))

    def table(cell: Callable[[Sequence[Run]], str]) -> list[str]:
        lines = [
            [tools[key].title, *(cell(_of(entry["runs"], case)) for case in cases)]
            for key, entry in found.items()
        ]
        return markdown(["", *cases], lines)

    effort = [
        [
            tools[key].title,
            entry["version"],
            str(entry["lines"]),
            tools[key].given,
            max(run["date"] for run in entry["runs"]),
        ]
        for key, entry in found.items()
    ]
    parts = [
        "### Accuracy",
        "",
        "Worst relative error of the five coefficients in percent: median/largest over the logs.",
        "",
        *table(_accuracy),
        "",
        "### Intervals",
        "",
        *wrap(
            "Nominal 95 % intervals that contain the true value, of all intervals; and the "
            "half-width of the widest of the five in percent, median over the logs.",
            _WIDTH,
        ),
        "",
        *table(_coverage),
        "",
        "### Time",
        "",
        "Wall time/processor time for one log in s, medians over the logs.",
        "",
        *table(_time),
        "",
        *_against_casadi(found),
        *_command(results.get("command")),
        "### Effort",
        "",
        *markdown(
            ["", "version", "lines", "given with log and model", "run"],
            effort,
        ),
        "",
        *_failures(tools, found),
        f"Machine: {results['machine']}; Python {results['python']}.",
    ]
    return "\n".join(parts) + "\n"


def _of(runs: Sequence[Run], case: str) -> list[Run]:
    return [run for run in runs if run["case"] == case]


def _worst(run: Run) -> float:
    return max(abs(error) for error in run["errors"])


def _accuracy(runs: Sequence[Run]) -> str:
    errors = [_worst(run) for run in runs if "failed" not in run]
    failed = len(runs) - len(errors)
    if not errors:
        return "failed" if runs else "–"
    text = f"{median(errors):.2g}"
    if len(runs) > 1:
        text += f"/{max(errors):.2g}"
    return f"{text}, {failed} of {len(runs)} failed" if failed else text


def _coverage(runs: Sequence[Run]) -> str:
    given = [run for run in runs if "inside" in run]
    if not given:
        return "–"
    inside = [held for run in given for held in run["inside"]]
    width = median(run["widest"] for run in given)
    return f"{sum(inside)}/{len(inside)} ±{width:.2g}"


def _time(runs: Sequence[Run]) -> str:
    timed = [run for run in runs if "seconds" in run]
    if not timed:
        return "–"
    return "/".join(f"{median(run[key] for run in timed):.2g}" for key in ("seconds", "processor"))


def _against_casadi(found: Mapping[str, Any]) -> list[str]:
    """Return the times that CasADi and flexid need for equal accuracy, with the same data."""
    runs = [_finished(found.get(key, {}).get("runs", [])) for key in ("flexid_10s", "casadi")]
    shared = sorted(runs[0].keys() & runs[1].keys())
    if not shared:
        return []
    (own, own_clock, own_processor), (error, clock, processor) = (
        (
            median(_worst(some[seed]) for seed in shared),
            median(some[seed]["seconds"] for seed in shared),
            median(some[seed]["processor"] for seed in shared),
        )
        for some in runs
    )
    text = (
        f"At equal accuracy ({_SAME_DATA}; errors {own:.2g} % and {error:.2g} %) CasADi's multiple "
        f"shooting takes {clock / own_clock:.0f} times as long as flexid's prediction error over "
        f"segments of 10 s, {processor / own_processor:.0f} times by processor time."
    )
    return [*wrap(text, _WIDTH), ""]


def _finished(runs: Sequence[Run]) -> dict[int, Run]:
    return {run["seed"]: run for run in _of(runs, _SAME_DATA) if "failed" not in run}


def _command(command: Mapping[str, float] | None) -> list[str]:
    if command is None:
        return []
    text = (
        f"The whole command `flexid identify examples/flexible_joint.csv --json`, imports "
        f"included: {command['later']:g} s, and {command['first']:g} s the first time on a "
        f"machine, when it compiles."
    )
    return [*wrap(text, _WIDTH), ""]


def _failures(tools: Mapping[str, Any], found: Mapping[str, Any]) -> list[str]:
    reasons = dict.fromkeys(
        f"{tools[key].title}, {run['case']}: {run['failed']}"
        for key, entry in found.items()
        for run in entry["runs"]
        if "failed" in run
    )
    if not reasons:
        return []
    return ["Failed:", "", *(f"- {reason}" for reason in reasons), ""]
