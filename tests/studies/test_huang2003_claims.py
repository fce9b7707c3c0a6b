"""The paper's claims and what decides them."""

import pytest

from flexid.studies.reproduction import Claim, Finding

VERDICTS = {
    "no acceleration": "holds",
    "error dynamics": "holds",
    "physical parameters": "holds",
    "V never rises": "holds",
    "printed bound": "does not hold",
    "rates vanish": "holds",
    "errors vanish": "holds",
    "only boundedness": "holds",
    "exponential rate": "holds",
    "(A4) for f": "holds",
    "(A4) for φ": "holds",
    "(A4) at any amplitude": "does not hold",
    "bounded signals": "depends on the reading",
    "arbitrarily small tracking errors": "depends on the reading",
    "price of a small k": "holds",
    "less torque": "holds",
    "zero within 30 s": "depends on the reading",
    "k leaves the estimates alone": "holds",
    "any controller": "holds",
}


def test_verdicts(reproduction):
    """Assert the verdict on every claim, and that none is left out."""
    assert {claim.key: claim.verdict for claim in reproduction.claims} == VERDICTS


def test_zero_within_30_s_is_true_of_one_reading_only(reproduction):
    """Assert that α2 is 34 % off under (1,2,3) and all is within 0.01 % under (1,1,3)."""
    claim = next(c for c in reproduction.claims if c.key == "zero within 30 s")
    values = {finding.subject: finding.value for finding in claim.findings}
    assert values["1,2,3"] == pytest.approx(0.3406, abs=1e-3)
    assert values["1,1,3"] < 1e-4


@pytest.mark.parametrize(
    ("value", "relation", "expected"),
    [(1.0, "<=", True), (1.1, "<=", False), (0.9, ">=", False), (float("nan"), "<=", False)],
)
def test_a_finding_compares_its_value_with_the_limit(value, relation, expected):
    """Assert both relations, and that a value that is no number bears nothing out."""
    assert Finding("any", "number", value, relation, 1.0).holds is expected


@pytest.mark.parametrize(
    ("values", "verdict"),
    [((0, 0), "holds"), ((2, 2), "does not hold"), ((0, 2), "depends on the reading")],
)
def test_verdict_of_a_claim(values, verdict):
    """Assert that a claim holds if all its findings do, and depends where they differ."""
    findings = tuple(Finding(str(i), "number", value, "<=", 1.0) for i, value in enumerate(values))
    assert Claim("key", "here", "it is so", findings).verdict == verdict
