"""What logs determine and what to play, as plain documents for JSON."""

from dataclasses import asdict
from typing import Any

from flexid.experiment_design.excitation_report import ExcitationReport
from flexid.report.documents import excitation_summary


def excitation_document(report: ExcitationReport) -> dict[str, Any]:
    """Everything of an excitation report but the spectrum."""
    assessment, found = report.assessment, report.identification
    alignment = found.choices.alignment
    return {
        "model": found.model,
        "coefficients": {name: asdict(c) for name, c in assessment.coefficients.items()},
        "excitation": {row: excitation_summary(e) for row, e in assessment.excitation.items()},
        "correlations": {name: dict(line) for name, line in assessment.correlations.items()},
        "advice": None if report.advice is None else asdict(report.advice),
        "noise": dict(report.noise),
        "residual_excess": dict(found.residual_excess),
        "terms": list(found.choices.terms),
        "hold": found.choices.hold,
        "input_delay": asdict(alignment.input_delay),
        "link_delay": asdict(alignment.link_delay),
        "supported": found.supports(),
        "warnings": list(found.warnings),
        "provenance": dict(found.provenance),
    }
