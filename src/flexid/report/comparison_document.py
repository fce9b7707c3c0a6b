"""Two estimates side by side, as a plain document for JSON."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from flexid.comparisons.comparison import Comparison
from flexid.comparisons.number_difference import Difference
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.report.comparison_summary import comparison_summary


def comparison_document(comparison: Comparison) -> dict[str, Any]:
    """Everything of a comparison, ready for JSON."""
    together = comparison.together
    return {
        "agree": comparison.agree,
        "differ": comparison.differ,
        "a": comparison.labels[0],
        "b": comparison.labels[1],
        "models": list(comparison.models),
        "logs": comparison.logs,
        "parameters": _differences(comparison.parameters),
        "coefficients": _differences(comparison.coefficients),
        "together": None if together is None else asdict(together),
        "settings": {name: {"a": a, "b": b} for name, (a, b) in comparison.settings.items()},
        "summary": list(comparison_summary(comparison)),
        "warnings": list(comparison.warnings),
        "provenance": dict(comparison.provenance),
    }


def _differences(differences: Mapping[str, Difference]) -> dict[str, Any]:
    return {name: _difference(d) for name, d in differences.items()}


def _difference(d: Difference) -> dict[str, Any]:
    return {
        "unit": d.unit,
        "a": _value(d.a),
        "b": _value(d.b),
        "without": list(d.without),
        "difference": d.value,
        "interval": list(d.interval),
        "percent": d.percent,
        "percent_interval": list(d.percent_interval),
        "probability": d.probability,
        "outcome": d.outcome,
        "reason": d.reason,
    }


def _value(value: ValueEstimate | None) -> dict[str, Any] | None:
    if value is None:
        return None
    return {
        "value": value.value,
        "std": value.std,
        "interval": list(value.interval),
        "verdict": value.verdict,
        "degrees_of_freedom": value.degrees_of_freedom,
    }
