"""Output of results: a table on the terminal, and `RESULTS.md`."""

import datetime
import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from textwrap import wrap

from rich.console import Console
from rich.table import Table

from benchmarks.comparison import HEADINGS, Comparison, Outcome

RESULTS = Path(__file__).with_name("RESULTS.md")

_WIDTH = 100  # columns
_PACKAGES = ("flexid", "numpy", "scipy", "numba", "casadi", "filterpy", "diffrax", "jax")


def show(outcomes: Sequence[Outcome]) -> None:
    """Print all comparisons as one table, with their descriptions."""
    comparisons = [c for outcome in outcomes for c in outcome.comparisons]
    table = Table("", *HEADINGS, title="flexid against other tools")
    for number, comparison in enumerate(comparisons, start=1):
        table.add_row(str(number), *comparison.cells())
    console = Console(width=_WIDTH)
    console.print(table)
    console.print("\n".join(_descriptions(comparisons)), markup=False, highlight=False)


def _ratios(comparisons: Sequence[Comparison]) -> list[str]:
    """Return the table of ratios with descriptions of its lines, as Markdown."""
    lines = [(str(n), *c.cells()) for n, c in enumerate(comparisons, start=1)]
    return [*markdown(("", *HEADINGS), lines), "", *_descriptions(comparisons)]


def _descriptions(comparisons: Sequence[Comparison]) -> list[str]:
    return [
        line
        for number, comparison in enumerate(comparisons, start=1)
        for line in wrap(f"{number}. {comparison.description}", _WIDTH, subsequent_indent="   ")
    ]


def write(outcomes: Sequence[Outcome], command: str, busy: float) -> None:
    """Write everything to `RESULTS.md`.

    Parameters
    ----------
    outcomes : sequence of Outcome
    command : str
        Command that was run.
    busy : float
        Load average of the machine before the run.
    """
    versions = ", ".join(f"{name} {_version(name)}" for name in _PACKAGES)
    text = [
        "# Benchmarks",
        "",
        f"Made by `{command}` on {datetime.datetime.now(datetime.UTC).date()} in one run.",
        "",
        f"- Machine: {processor()}, {os.cpu_count()} cores, {platform.system()}; load average "
        f"{busy:.2f} before the run, niceness {os.nice(0)}.",
        f"- Versions: Python {platform.python_version()}, {versions}.",
        "- Times are medians, after a warm-up, of wall time unless the line says otherwise; what "
        "is compared runs in turn, and ratios are ratios of medians. What takes many seconds is "
        "run once. What limits them: [performance](../docs/comparison.md#performance).",
        "",
        *_ratios([c for outcome in outcomes for c in outcome.comparisons]),
    ]
    for outcome in outcomes:
        for detail in outcome.details:
            text += ["", f"## {detail.title}", "", *markdown(detail.headings, detail.lines)]
            text += ["", detail.remark] if detail.remark else []
    RESULTS.write_text("\n".join(text) + "\n", encoding="utf-8")


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def markdown(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> list[str]:
    rule = ["---"] * len(headings)
    return [f"|{'|'.join(line)}|" for line in (headings, rule, *lines)]


def processor() -> str:
    """Return the model of the processor, or else the machine's type."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()
