"""Two estimates side by side, as a plain document for JSON."""

from collections.abc import Mapping
from typing import Any

from flexid.comparisons.comparison import Comparison
from flexid.comparisons.number_difference import Difference
from flexid.report.comparison_summary import comparison_summary
from flexid.report.documents import plain


def comparison_document(comparison: Comparison) -> dict[str, Any]:
    """Everything of a comparison, ready for JSON."""
    return {
        "agree": comparison.agree,
        "differ": comparison.differ,
        "a": comparison.labels[0],
        "b": comparison.labels[1],
        "models": comparison.models,
        "logs": comparison.logs,
        "parameters": _differences(comparison.parameters),
        "coefficients": _differences(comparison.coefficients),
        "together": comparison.together,
        "settings": {name: {"a": a, "b": b} for name, (a, b) in comparison.settings.items()},
        "summary": comparison_summary(comparison),
        "warnings": comparison.warnings,
        "provenance": comparison.provenance,
    }


def _differences(differences: Mapping[str, Difference]) -> dict[str, Any]:
    found = {}
    for name, difference in differences.items():
        document = plain(difference)
        del document["name"]
        found[name] = document | {"difference": document.pop("value")}
    return found
