"""What identification says of a joint that its model does not describe."""

import numpy as np
import pytest

from flexid.identification.identify import identify
from flexid.identification.settings import Settings
from flexid.models.flexible_joint import PAPER_TERMS, flexible_joint
from flexid.recording.recording import Log, Recording
from flexid.simulation.free_run import free_run

TRUE = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}


def identified(term=None, coefficients=None, noise=1e-5, terms=PAPER_TERMS):
    """Identify a joint with a term more than the paper's, from two tones at 500 Hz."""
    t = np.arange(0, 30, 0.002)
    u = 20 * np.sin(2 * t) + 10 * np.sin(5.3 * t)
    system = flexible_joint(PAPER_TERMS if term is None else (*PAPER_TERMS, term))
    x = free_run(system, {**TRUE, **(coefficients or {})}, np.zeros(4), u, 0.002)
    rng = np.random.default_rng(3)
    link, motor = (x[:, [0, 2]] + noise * rng.standard_normal((len(t), 2))).T.copy()
    log = Log((Recording(0.002, 0.0, link, motor, u, "N m"),), (), "log", "")
    return identify([log], Settings(terms=terms))


MISSING = [
    ("cubic_stiffness", {"theta_cubic": 2000.0, "alpha_cubic": 20000 / 3}),
    ("motor_coulomb", {"alpha_coulomb": 10.0}),
]


@pytest.mark.parametrize(("term", "coefficients"), MISSING)
def test_inertia_spoilt_by_a_missing_term_is_not_called_known(term, coefficients):
    """Assert that the motor's gain is doubted where a missing term leaves far more than noise."""
    result = identified(term, coefficients)
    assert max(result.residual_excess.values()) > 5  # the term matters
    assert result.coefficients["beta1"].status != "determined"


@pytest.mark.parametrize(("term", "coefficients"), MISSING)
def test_missing_term_is_found(term, coefficients):
    """Assert that auto adds the term that the log shows, and gets every size right."""
    result = identified(term, coefficients, terms="auto")
    assert {*PAPER_TERMS, term} <= set(result.choices.terms)
    for name, value in {**TRUE, **coefficients}.items():
        assert result.coefficients[name].value == pytest.approx(value, rel=0.01)
    assert all(e.without_term > e.with_term for e in result.choices.term_evidence if e.chosen)


@pytest.mark.parametrize("noise", [1e-5, 1e-2])
def test_right_model_is_not_doubted(noise):
    """Assert that noise alone makes no coefficient of a right model look doubtful."""
    result = identified(noise=noise)
    assert {c.status for c in result.coefficients.values()} == {"determined"}
