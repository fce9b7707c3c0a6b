"""A stored estimate held against other logs, as a plain document for JSON."""

from math import isinf
from typing import Any

from flexid.stored_estimates.validate_estimate import EstimateValidation


def validation_document(result: EstimateValidation) -> dict[str, Any]:
    """Everything of a validation but its time series."""
    return {
        "model": result.model,
        "fit_percent": dict(result.fit_percent),
        "horizons": {f"{h:g}": dict(fits) for h, fits in result.horizons.items()},
        "residuals": {horizon_name(h): dict(rms) for h, rms in result.residuals.items()},
        "noise": dict(result.noise),
        "warnings": list(result.warnings),
        "provenance": dict(result.provenance),
    }


def horizon_name(horizon: float) -> str:
    """A horizon in s as the key of a document; the free run is one without an end."""
    return "free" if isinf(horizon) else f"{horizon:g}"
