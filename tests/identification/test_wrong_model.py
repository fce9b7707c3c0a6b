"""What identification says of a joint that its model does not describe."""

import json
from dataclasses import replace
from functools import cache

import pytest
from made_joint import COEFFICIENTS, TRUTH, log, made

from flexid.arrays import to_json
from flexid.errors import SettingError
from flexid.exports.request import request_of_identification
from flexid.frequency.linear_joint import linear_joint
from flexid.identification.identify import identify
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import PAPER_TERMS
from flexid.stored_estimates.estimate_file import estimate_document, read_estimate
from flexid.stored_estimates.validate_estimate import validate_estimate

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
    "spring_hysteresis": (
        {"hysteresis_torque": 0.5, "hysteresis_reach": 0.03},
        {"spring_hysteresis": 0.5, "hysteresis_reach": 0.03},
    ),
}


@cache
def identified(term: str, terms: tuple[str, ...] | None):
    """Identify ten seconds of a joint with a term more than the paper's."""
    more, _ = MISSING[term]
    recording = made(1, **more)  # pyright: ignore[reportArgumentType]
    return identify([log(recording)], Settings(terms=terms or "auto"))


@pytest.mark.parametrize(
    "term",
    [
        "cubic_stiffness",
        "motor_coulomb",
        pytest.param(
            "link_coulomb",
            marks=pytest.mark.xfail(reason="its residuals grow like noise", strict=True),
        ),
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
    assert any("no term here describes" in warning for warning in result.warnings)


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


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["shape_promise", "shape_share"])
def test_hysteresis_has_to_explain_what_is_left(name):
    """Assert that a model is left without it where it takes away less than is asked."""
    more, _ = MISSING["spring_hysteresis"]
    recording = made(1, **more)  # pyright: ignore[reportArgumentType]
    result = identify([log(recording)], thresholds=replace(THRESHOLDS, **{name: 1.01}))
    assert "spring_hysteresis" not in result.choices.terms


def test_hysteresis_may_be_asked_for():
    """Assert that it is found where the terms are given."""
    result = identified("spring_hysteresis", (*PAPER_TERMS, "spring_hysteresis"))
    for name, true in {**TRUTH, **MISSING["spring_hysteresis"][1]}.items():
        assert result.parameters[name].value == pytest.approx(true, rel=0.01), name


def test_an_estimate_with_hysteresis_predicts_another_log():
    """Assert that what is stored of it follows the same drive elsewhere, nearly to the noise."""
    more, _ = MISSING["spring_hysteresis"]
    document = json.loads(to_json(estimate_document(identified("spring_hysteresis", None))))
    other = log(made(2, **more))  # pyright: ignore[reportArgumentType]
    answer = validate_estimate(read_estimate(document), [other])
    assert min(answer.fit_percent.values()) > 99.0


def test_hysteresis_is_no_stiffness_of_a_linear_joint():
    """Assert that a linearisation has the spring alone, and that no memory is exported."""
    result = identified("spring_hysteresis", None)
    linear = linear_joint(result)
    assert "hysteresis_grip" not in linear.names
    with pytest.raises(SettingError, match="identify with --terms gravity,motor_viscous"):
        request_of_identification(result)
