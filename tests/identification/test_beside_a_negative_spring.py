"""What is believed where a stiffness came out negative."""

import numpy as np
import pytest

from flexid.identification.judgement.estimates import coefficient_estimates, parameter_estimates
from flexid.identification.preparation.joint import flexible
from flexid.identification.vocabulary.estimate import Estimate
from flexid.models.flexible_joint import PAPER_TERMS

JOINT = flexible()
UNKNOWNS = JOINT.unknowns(JOINT.optional - {c for t in PAPER_TERMS for c in JOINT.terms[t]}, {})
VALUES = {"theta1": 5.0, "theta2": 100.0, "alpha1": 300.0, "alpha2": 0.7, "beta1": 3.0}


def verdicts(theta2: float, std: float = 0.01) -> dict[str, str]:
    """Verdicts on all coefficients and parameters, all but theta2 known to 1 %."""
    values = np.array([*({**VALUES, "theta2": theta2}).values()])
    deviations = 0.005 * np.abs(values)
    deviations[1] = std * abs(theta2)
    estimate = Estimate(tuple(VALUES), values, np.diag(deviations**2), (50.0,) * len(VALUES))
    found = coefficient_estimates(estimate, JOINT, UNKNOWNS, {}, {}, "N m")
    parameters = parameter_estimates(JOINT, estimate, UNKNOWNS, found, "N m")
    return {name: e.verdict for name, e in (*found.items(), *parameters.items())}


def test_beside_a_spring_all_is_determined():
    """Assert that these verdicts are those of the intervals."""
    assert set(verdicts(100.0).values()) == {"determined"}


@pytest.mark.parametrize("theta2", [-100.0, -1e-3])
def test_a_negative_stiffness_leaves_the_other_balance_alone(theta2):
    """Assert that nothing of the link's is determined, and all that is the motor's alone."""
    found = verdicts(theta2)
    determined = {name for name, verdict in found.items() if verdict == "determined"}
    motor = {"alpha1", "alpha2", "beta1"}
    assert determined == motor | {"joint_stiffness", "motor_inertia", "motor_viscous_friction"}


def test_a_stiffness_that_is_not_known_says_nothing_of_the_rest():
    """Assert that one which the log leaves free may have any sign."""
    found = verdicts(-100.0, np.inf)
    assert found["theta2"] == "undetermined"
    assert found["alpha1"] == found["beta1"] == found["motor_inertia"] == "determined"
