"""The printed summary of a campaign, at most 100 columns wide."""

from collections.abc import Callable, Iterator, Sequence
from math import isfinite

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from flexid.campaigns.summary import QUANTILES, Result, Summary
from flexid.report.terminal import print_parts, titled_table

DETAILS = ("final_error.", "final_state.")
"""Prefixes of results that are quantified, but of which no more is said."""

_SHOWN = 4  # inputs named for a result


def print_campaign(summary: Summary) -> None:
    """Print statuses, quantiles and what matters on standard output."""
    print_parts(_parts(summary))


def _parts(summary: Summary) -> Iterator[RenderableType]:
    yield from (Text(line) for line in status_lines(summary))
    yield Text()
    yield _quantiles(summary)
    yield _importance(summary, "What matters most: rank correlation", correlation_text)
    if summary.manifest.kind == "sobol-indices":
        title = "Share of the variance (Sobol indices), interactions included (and alone)"
        yield _importance(summary, title, index_text)
    missing = [result for result in summary.results if result.missing]
    if missing:
        yield Text(
            "None: finished runs without this result; an estimate that does not stay within 5 % "
            "of the truth has no settling time."
        )


def status_lines(summary: Summary) -> Iterator[str]:
    """How many runs are done, and how they ended, in sentences."""
    total = summary.manifest.runs
    if summary.complete:
        yield f"{total} runs, {summary.manifest.kind}"
    else:
        yield (
            f"Unfinished: {summary.done} of {total} runs, {summary.manifest.kind}; the command "
            f"that began the campaign goes on with it"
        )
    yield ", ".join(
        f"{name} {count} ({100 * count / summary.done:.3g} %)"
        for name, count in summary.statuses.items()
    )
    if summary.first_error:
        yield f"The first error: {summary.first_error}"
    if summary.damaged:
        yield (
            f"Damaged and left out: {', '.join(summary.damaged)}; the command that began the "
            f"campaign makes them anew"
        )


def _quantiles(summary: Summary) -> Table:
    table = titled_table(f"{summary.finished} finished runs, SI units", collapse_padding=True)
    table.add_column("result", no_wrap=True)
    for share in QUANTILES:
        table.add_column(f"{100 * share:g} %", justify="right", no_wrap=True)
    table.add_column("none", justify="right", no_wrap=True)
    for result in summary.results:
        shown = (f"{value:.4g}" if isfinite(value) else "" for value in result.quantiles)
        table.add_row(result.name, *shown, str(result.missing or ""))
    return table


def _importance(summary: Summary, title: str, text: Callable[[Result], str]) -> Table:
    table = titled_table(title, collapse_padding=True)
    table.add_column("result", no_wrap=True)
    table.add_column("inputs")
    for result in summary.results:
        if not result.name.startswith(DETAILS):
            table.add_row(result.name, text(result))
    return table


def correlation_text(result: Result) -> str:
    """The strongest rank correlations of a result in words."""
    told = [f"{one.input} {one.value:+.2f}" for one in result.correlations if one.significant]
    return _sentence(told, len(result.correlations))


def index_text(result: Result) -> str:
    """The largest Sobol indices of a result in words."""
    told = [
        f"{one.input} {one.total:.2f} ± {one.total_half_width:.2f} ({one.first:.2f})"
        for one in result.indices
        if one.total > one.total_half_width
    ]
    return _sentence(told, len(result.indices))


def _sentence(told: Sequence[str], inputs: int) -> str:
    if not inputs:
        return "does not vary, or in too few runs"
    if not told:
        return "none is significant"
    parts = [*told[:_SHOWN]]
    if len(told) > _SHOWN:
        parts.append(f"and {len(told) - _SHOWN} more")
    untold = inputs - len(told)
    return ", ".join(parts) + (f"; {untold} not significant" if untold else "")
