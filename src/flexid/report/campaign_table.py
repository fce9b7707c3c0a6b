"""The printed summary of a campaign."""

from collections.abc import Callable, Iterator, Sequence
from math import isfinite

from rich.text import Text

from flexid.campaigns.summary import QUANTILES, Result, Summary
from flexid.report.terminal import Column, Part, Table, number, numbers

DETAILS = ("final_error.", "final_state.")
"""Prefixes of results that are quantified, but of which no more is said."""

_SHOWN = 4  # inputs named for a result


def campaign_parts(summary: Summary) -> Iterator[Part]:
    """Tables and sentences of the answer."""
    yield from (Text(line) for line in status_lines(summary))
    yield Text()
    yield quantiles_table(summary)
    yield from importance_parts(summary)


def importance_parts(summary: Summary) -> Iterator[Part]:
    """What matters for each result, as tables."""
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
            f"campaign replaces them"
        )


def quantiles_table(summary: Summary) -> Table:
    """Quantiles of each result over the finished runs."""
    shares = (f"{100 * share:g} %" for share in QUANTILES)
    columns = (Column("result"), *numbers(*shares, "none"))
    table = Table(f"{summary.finished} finished runs, SI units", columns)
    for result in summary.results:
        shown = (number(value, 4) if isfinite(value) else "" for value in result.quantiles)
        table.add(result.name, *shown, str(result.missing or ""))
    return table


def _importance(summary: Summary, title: str, text: Callable[[Result], str]) -> Table:
    table = Table(title, (Column("result"), Column("inputs", wraps=True)))
    for result in summary.results:
        if not result.name.startswith(DETAILS):
            table.add(result.name, text(result))
    return table


def correlation_text(result: Result) -> str:
    """The strongest rank correlations of a result in words."""
    shown = [f"{one.input} {one.value:+.2f}" for one in result.correlations if one.significant]
    return _sentence(shown, len(result.correlations))


def index_text(result: Result) -> str:
    """The largest Sobol indices of a result in words."""
    shown = [
        f"{one.input} {one.total:.2f} ± {one.total_half_width:.2f} ({one.first:.2f})"
        for one in result.indices
        if one.total > one.total_half_width
    ]
    return _sentence(shown, len(result.indices))


def _sentence(significant: Sequence[str], inputs: int) -> str:
    if not inputs:
        return "does not vary, or in too few runs"
    if not significant:
        return "none is significant"
    parts = [*significant[:_SHOWN]]
    if len(significant) > _SHOWN:
        parts.append(f"and {len(significant) - _SHOWN} more")
    others = inputs - len(significant)
    return ", ".join(parts) + (f"; {others} not significant" if others else "")
