"""What is known of a stream at a moment, ready for JSON."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from flexid.streaming.session import Session


def watch_document(session: Session) -> dict[str, Any]:
    """Health, parameters and what happened to the samples."""
    judgement = session.health
    return {
        "time": session.time,
        "health": judgement.health.words,
        "reason": judgement.reason,
        "parameters": _values(session.parameters),
        "coefficients": _values(session.coefficients),
        "excitation": {name: found.condition_number for name, found in session.excitation.items()},
        "samples": asdict(session.counts),
        "changes": [asdict(change) for change in session.changes],
        "departures": [
            {"name": d.name, "unit": d.unit, "was": d.was, "now": d.now, "change": d.change}
            for d in session.departures
        ],
        "options": session.options.document,
    }


def _values(found: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: {
            "value": estimate.value,
            "interval": list(estimate.interval),
            "unit": estimate.unit,
            "verdict": estimate.verdict,
        }
        for name, estimate in found.items()
    }
