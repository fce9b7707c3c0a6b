"""A negative spring or inertia spoils what is said of its own row, and of no other."""

import numpy as np
import pytest

from flexid.identification.judgement.estimates import coefficient_estimates
from flexid.identification.preparation.joint import flexible
from flexid.identification.vocabulary.estimate import Estimate
from flexid.models.flexible_joint import PAPER_TERMS

JOINT = flexible()
UNKNOWNS = JOINT.unknowns(JOINT.optional - {c for t in PAPER_TERMS for c in JOINT.terms[t]}, {})
VALUES = {"theta1": 5.0, "theta2": 100.0, "alpha1": 300.0, "alpha2": 0.7, "beta1": 3.0}
LINK, MOTOR = {"theta1", "theta2"}, {"alpha1", "alpha2", "beta1"}


def verdicts(negative: str) -> dict[str, str]:
    """Verdicts on coefficients that are known to 1 %, one of them of the wrong sign."""
    named = {**VALUES, negative: -VALUES[negative]}
    values = np.array([*named.values()])
    covariance = np.diag((0.005 * values) ** 2)
    estimate = Estimate(tuple(named), values, covariance, (50.0,) * len(named))
    found = coefficient_estimates(estimate, JOINT, UNKNOWNS, {}, {}, "N m")
    return {name: e.verdict for name, e in found.items()}


@pytest.mark.parametrize(
    ("negative", "own", "other"),
    [("alpha1", MOTOR, LINK), ("beta1", MOTOR, LINK), ("theta2", LINK, MOTOR)],
)
def test_the_other_row_stands_for_itself(negative, own, other):
    """Assert that a row with a negative spring or inertia is undetermined, and the other not."""
    found = verdicts(negative)
    assert {found[name] for name in own} == {"undetermined"}
    assert {found[name] for name in other} == {"determined"}
