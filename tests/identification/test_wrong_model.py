"""What identification says of a joint that its model does not describe."""

from functools import cache

import pytest
from made_joint import COEFFICIENTS, TRUTH, log, made

from flexid.identification.identify import identify
from flexid.identification.settings import Settings
from flexid.models.flexible_joint import PAPER_TERMS

MISSING = {
    "cubic_stiffness": ({"cubic_stiffness": 2000.0}, {"cubic_joint_stiffness": 2000.0}),
    "motor_coulomb": (
        {"motor_coulomb_up": 2.0, "motor_coulomb_down": 2.0},
        {"motor_coulomb_friction": 2.0},
    ),
    "link_coulomb": ({"link_coulomb": 1.0}, {"link_coulomb_friction": 1.0}),
    "torque_saturation": (
        {"saturation": 0.1, "peak_torque": 30.0},
        {"torque_saturation": 0.1 / 30.0**2},
    ),
}


@cache
def identified(term: str, terms: tuple[str, ...] | None):
    """Identify ten seconds of a joint with a term more than the paper's."""
    more, _ = MISSING[term]
    recording = made(1, **more)  # pyright: ignore[reportArgumentType]
    return identify([log(recording)], Settings(terms=terms or "auto"))


UNSEEN = pytest.mark.xfail(reason="its residuals grow like noise", strict=True)


@pytest.mark.parametrize(
    "term",
    [
        "cubic_stiffness",
        "motor_coulomb",
        pytest.param("link_coulomb", marks=UNSEEN),
    ],
)
def test_what_a_missing_term_spoils_is_covered_or_doubted(term):
    """Assert that intervals of a model that lacks a term hold the truth, or no one is sure."""
    result = identified(term, PAPER_TERMS)
    assert max(result.residual_excess.values()) > 5  # the term matters
    for name, true in COEFFICIENTS.items():
        found = result.coefficients[name]
        lower, upper = found.interval
        assert lower <= true <= upper or found.verdict != "determined", name


@pytest.mark.parametrize(
    "term", ["cubic_stiffness", "motor_coulomb", pytest.param("link_coulomb", marks=UNSEEN)]
)
def test_missing_term_is_told(term):
    """Assert that a warning says that the drive has more than the model."""
    warnings = identified(term, PAPER_TERMS).warnings
    assert any("the drive has something that no term here describes" in w for w in warnings)


@pytest.mark.parametrize("term", MISSING)
def test_term_is_found(term):
    """Assert that auto finds the term that the log shows, and gets every size right."""
    result = identified(term, None)
    assert {*PAPER_TERMS, term} <= set(result.choices.terms)
    for name, true in {**TRUTH, **MISSING[term][1]}.items():
        assert result.parameters[name].value == pytest.approx(true, rel=0.01), name
        assert result.parameters[name].verdict == "determined", name


@pytest.mark.parametrize("noise", [1e-5, 1e-3])
def test_right_model_is_not_doubted(noise):
    """Assert that noise alone makes no coefficient of a right model look doubtful."""
    result = identify([log(made(1, noise=noise))], Settings(terms=PAPER_TERMS))
    assert {c.verdict for c in result.coefficients.values()} == {"determined"}
    assert result.model_error.share == 0.0
