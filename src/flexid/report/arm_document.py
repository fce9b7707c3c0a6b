"""The answer for an arm as a plain document for JSON."""

from typing import Any

from flexid.arms.result import ArmIdentification


def arm_document(result: ArmIdentification) -> dict[str, Any]:
    """Everything of the answer, ready for JSON."""
    return {
        "kind": "planar arm",
        "arm": result.arm,
        "joints": [
            {p.name: p for p in result.of_joint(joint)} for joint in range(1, result.arm.joints + 1)
        ],
        "fit": {
            "names": result.names,
            "covariance": result.covariance,
            "fixed": result.fixed,
        },
        "free_run_percent": result.free_run,
        "residual_excess": result.residual_excess,
        "hold": result.hold,
        "input_delay": result.input_delay,
        "segment_duration": result.segment_duration,
        "condition_number": result.condition_number,
        "warnings": result.warnings,
        "provenance": result.provenance,
    }
