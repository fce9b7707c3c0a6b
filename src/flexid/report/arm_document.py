"""The answer for an arm as a plain document for JSON."""

from dataclasses import asdict
from typing import Any

from flexid.arms.result import ArmIdentification


def arm_document(result: ArmIdentification) -> dict[str, Any]:
    """Everything of the answer, ready for JSON."""
    return {
        "kind": "planar arm",
        "arm": asdict(result.arm),
        "joints": [
            {p.name: {**asdict(p), "interval": list(p.interval)} for p in result.of_joint(joint)}
            for joint in range(1, result.arm.joints + 1)
        ],
        "fit": {
            "names": list(result.names),
            "covariance": result.covariance.tolist(),
            "fixed": dict(result.fixed),
        },
        "free_run_percent": dict(result.free_run),
        "residual_excess": dict(result.residual_excess),
        "hold": result.hold,
        "input_delay": result.input_delay,
        "segment_duration": result.segment_duration,
        "condition_number": result.condition_number,
        "warnings": list(result.warnings),
        "provenance": dict(result.provenance),
    }
