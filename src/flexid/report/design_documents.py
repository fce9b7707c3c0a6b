"""What logs tell and what to play, as plain documents for JSON."""

from dataclasses import asdict
from typing import Any

from flexid.design.excitation_report import ExcitationReport
from flexid.report.documents import excitation_summary


def excitation_document(report: ExcitationReport) -> dict[str, Any]:
    """Everything of an excitation report but the spectrum."""
    assessment = report.assessment
    return {
        "coefficients": {name: asdict(c) for name, c in assessment.coefficients.items()},
        "excitation": {row: excitation_summary(e) for row, e in assessment.excitation.items()},
        "correlations": {
            name: dict(zip(report.information.names, line, strict=True))
            for name, line in zip(
                report.information.names, report.information.correlations.tolist(), strict=True
            )
        },
        "advice": None if report.advice is None else asdict(report.advice),
        "noise": dict(report.noise),
        "hold": report.hold,
        "filter_rate": report.filter_rate,
        "supported": report.supported,
        "warnings": list(report.warnings),
        "provenance": dict(report.provenance),
    }
