"""What logs determine and what to play, as plain documents for JSON."""

from typing import Any

from flexid.experiment_design.excitation_report import ExcitationReport
from flexid.report.documents import excitation_summary


def excitation_document(report: ExcitationReport) -> dict[str, Any]:
    """Everything of an excitation report but the spectrum."""
    assessment, found = report.assessment, report.identification
    alignment = found.choices.alignment
    return {
        "model": found.model,
        "coefficients": assessment.coefficients,
        "excitation": {row: excitation_summary(e) for row, e in assessment.excitation.items()},
        "correlations": assessment.correlations,
        "advice": report.advice,
        "noise": report.noise,
        "residual_excess": found.residual_excess,
        "terms": found.choices.terms,
        "hold": found.choices.hold,
        "input_delay": alignment.input_delay,
        "link_delay": alignment.link_delay,
        "supported": found.supports(),
        "warnings": found.warnings,
        "provenance": found.provenance,
    }
