"""A campaign as tables and JSON."""

from collections.abc import Iterator
from math import isfinite
from typing import Any

from flexid.experiments.campaign_store import QUANTILES, Summary
from flexid.report.terminal import Part, Table, number, numbers


def parts(summary: Summary) -> Iterator[Part]:
    """Return how many runs are done, with which status, and quantiles of each result."""
    total = summary.manifest.runs
    if summary.complete:
        yield f"{total} runs, {summary.manifest.kind}"
    else:
        yield (
            f"Unfinished: {summary.done} of {total} runs, {summary.manifest.kind}; the command "
            f"that began the campaign continues it"
        )
    yield ", ".join(
        f"{name} {count} ({100 * count / summary.done:.3g} %)"
        for name, count in summary.statuses.items()
    )
    if summary.first_error:
        yield f"First error: {summary.first_error}"
    if summary.damaged:
        yield (
            f"Damaged and left out: {', '.join(summary.damaged)}; the command that began the "
            f"campaign replaces them"
        )
    yield ""
    shares = (f"{100 * share:g} %" for share in QUANTILES)
    columns = ("result", *numbers(*shares, "missing"))
    table = Table(f"{summary.finished} finished runs, SI units", columns)
    for name, result in summary.results.items():
        values = result.quantiles.values()
        shown = (number(value, 4) if isfinite(value) else "" for value in values)
        table.add(name, *shown, str(result.missing or ""))
    yield table
    if any(result.missing for result in summary.results.values()):
        yield (
            "Missing: finished runs without this result. An estimate that does not stay within 5 % "
            "of the truth has no settling time."
        )


def heading(summary: Summary) -> tuple[str, str]:
    """Return the name and folder of the campaign."""
    return f"Campaign {summary.directory.name}", str(summary.directory)


def document(summary: Summary) -> dict[str, Any]:
    """Return the results of a campaign for JSON."""
    manifest = summary.manifest
    return {
        "kind": manifest.kind,
        "runs": manifest.runs,
        "done": summary.done,
        "complete": summary.complete,
        "damaged": summary.damaged,
        "statuses": summary.statuses,
        "first_error": summary.first_error,
        "inputs": manifest.inputs,
        "results": summary.results,
        "provenance": {
            "version": manifest.flexid,
            "experiment": manifest.experiment,
            "plan": manifest.plan,
        },
    }
