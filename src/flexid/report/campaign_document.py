"""A campaign's summary as a plain document for JSON."""

from typing import Any

from flexid.campaigns.summary import QUANTILES, Result, Summary


def campaign_document(summary: Summary) -> dict[str, Any]:
    """Everything of a summary but the values of the single runs, ready for JSON."""
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
        "results": {result.name: _result(result) for result in summary.results},
        "provenance": {
            "version": manifest.flexid,
            "experiment": manifest.experiment,
            "plan": manifest.plan,
        },
    }


def _result(result: Result) -> dict[str, Any]:
    return {
        "finite": len(result.values) - result.missing,
        "missing": result.missing,
        "quantiles": {
            f"{share:g}": value for share, value in zip(QUANTILES, result.quantiles, strict=True)
        },
        "rank_correlations": result.correlations,
        "sobol_indices": result.indices,
    }
