"""A synthetic identification with every part of the printed answer and the document."""

from dataclasses import replace

import numpy as np

from flexid.identification.preparation.recordings import Alignment, Delay
from flexid.identification.result import Choices, Identification
from flexid.identification.vocabulary import evidence
from flexid.identification.vocabulary.evidence import Estimate
from made_estimates import TRUE, exact

INFINITE = float("inf")

CHOICES = Choices(
    terms=("gravity", "motor_coulomb"),
    alignment=Alignment(
        "zero",
        Delay(0.00302, 1e-4, (0.00287, 0.00317), "found"),
        Delay(0.0, 1e-4, (-2e-4, 3e-4), "none"),
        "the log does not distinguish the holds; this one needs the least delay",
    ),
    hold="zero",
    coulomb_velocity=0.0123,
    filter_rate=31.4,
    estimator="prediction-error",
    segment_duration=1.99,
    term_evidence=(
        evidence.TermEvidence("theta1", True, 5.0123, 0.021, 1e-20),
        evidence.TermEvidence("alpha_cubic", False, 0.456, 0.789, 0.57),
        evidence.TermEvidence("theta_cosine", False, 0.0, INFINITE, 1.0),
    ),
    segment_evidence=(
        evidence.SegmentEvidence(0.995, 1.21, 0.0345),
        evidence.SegmentEvidence(1.99, 1.44, 0.0123),
    ),
)

VALIDATION = evidence.Validation(
    {"link_position": 99.1, "motor_position": 98.2, "deflection": float("nan")},
    (evidence.FreeRun(np.arange(3.0), np.zeros((3, 3)), np.ones((3, 3))),),
    {
        0.05: {"link_position": 99.9, "motor_position": 99.8, "deflection": float("nan")},
        0.2: {"link_position": 99.7, "motor_position": 99.6, "deflection": float("nan")},
        1.0: {"link_position": 99.5, "motor_position": 99.4, "deflection": float("nan")},
    },
)


def made_result(model_error: evidence.ModelError | None = None) -> Identification:
    """Return an identification in which each number occurs once."""
    return replace(
        exact(TRUE, ""),
        coefficients={
            "theta1": evidence.ValueEstimate("theta1", "1/s^2", 5.0, 0.1, (4.8, 5.2), "determined"),
            "alpha_coulomb": evidence.ValueEstimate(
                "alpha_coulomb", "rad/s^2", 2.0, 0.5, (1.0, 3.0), "weak", "its interval is wide"
            ),
        },
        parameters={
            "gravity_torque": evidence.ValueEstimate(
                "gravity_torque", "N m", 7.0, 0.1, (6.8, 7.2), "determined"
            )
        },
        least_squares={"theta1": 5.0456},
        residual_excess={"link_position": 1.02, "motor_position": 3.04},
        model_error=model_error or evidence.ModelError(0.05, 0.9, 0.0),
        validation=VALIDATION,
        removed={
            "joint_damping": evidence.ValueEstimate(
                "joint_damping", "N m s/rad", 1e-4, 2e-4, (-3e-4, 5e-4), "undetermined"
            ),
            "gravity_angle": evidence.ValueEstimate(
                "gravity_angle", "rad", 0.0, INFINITE, (-INFINITE, INFINITE), "undetermined"
            ),
        },
        fit=Estimate(("theta1",), np.array([5.0]), np.array([[0.01]]), (9.0,)),
        choices=CHOICES,
        summary=("Model: gravity, motor_coulomb.",),
        warnings=("a warning",),
        provenance={"flexid_version": "0"},
        disturbances=evidence.Disturbances({"link": 0.021, "motor": 0.13}, 0.004, 0.02),
    )
