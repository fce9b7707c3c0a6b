"""The flexible joint of eq. (4) and its terms."""

from pathlib import Path

import pytest

from flexid.errors import SettingError
from flexid.models.expression import evaluate
from flexid.models.flexible_joint import (
    SHAPE_TERMS,
    TERMS,
    TIES,
    flexible_joint,
)
from flexid.models.rigid_joint import rigid_joint

NOTATION = Path(__file__).parents[2] / "docs" / "commands.md"
EVERY = TERMS | SHAPE_TERMS


def test_paper_s_model():
    """Assert that the default is eq. (4) with beta1 unknown."""
    link, motor = flexible_joint().rows
    assert dict(link.regressors) == {"theta1": "-sin(x1)", "theta2": "-(x1 - x3)"}
    assert dict(motor.regressors) == {"alpha1": "x1 - x3", "alpha2": "-x4", "beta1": "u"}


def test_known_coefficient_moves_to_the_known_part():
    """Assert that a known beta1 is a constant of the model and no unknown."""
    system = flexible_joint(known={"beta1": 4.0})
    assert system.coefficients == ("theta1", "theta2", "alpha1", "alpha2")
    assert system.rows[1].known == "beta1*(u)"
    assert system.constants == {"beta1": 4.0}


@pytest.mark.parametrize("term", TERMS)
def test_each_term_adds_its_coefficients(term: str):
    """Assert that a term adds what it declares, and nothing else, to the bare joint."""
    bare = set(flexible_joint(()).coefficients)
    added = set(flexible_joint((term,)).coefficients) - bare
    assert added == {*TERMS[term].link, *TERMS[term].motor}


REFUSED = {
    "a term": (flexible_joint, ("magnets",), {}, 0.1, "magnets"),
    "a coefficient": (flexible_joint, (), {"beta2": 1.0}, 0.1, "beta2"),
    "a term of the flexible joint": (rigid_joint, ("motor_viscous",), {}, 0.1, "viscous"),
    "a coefficient of the flexible joint": (rigid_joint, (), {"theta1": 1}, 0.1, "theta1"),
    **{
        f"smoothing over {velocity}": (
            *(flexible_joint, ("motor_coulomb",), {}, velocity),
            "coulomb_velocity",
        )
        for velocity in (0.0, -0.1, float("nan"), float("inf"))
    },
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_no_joint_has_is_refused(case: str):
    """Assert that an unknown term or coefficient and an impossible smoothing are named."""
    joint, terms, known, velocity, word = REFUSED[case]
    with pytest.raises(SettingError, match=word):
        joint(terms, known, velocity)


@pytest.mark.parametrize("term", sorted({*EVERY} - {"eccentricity"}))
def test_terms_of_the_spring_are_tied(term: str):
    """Assert that what acts on both sides of the spring is one torque over each side's inertia."""
    declared = EVERY[term]
    model = flexible_joint((term,))
    values = {x: 0.1 * (i + 1) for i, x in enumerate(model.states)} | {**model.constants, "u": 0.0}
    texts = {name: text for row in model.rows for name, text in row.regressors.items()}
    for name in declared.link if declared.motor else ():
        source, *ratio = TIES[name]
        assert ratio == ["theta2", "alpha1"]
        here, there = (evaluate(texts[one], values, one) for one in (name, source))
        assert here == pytest.approx(-there)


@pytest.mark.parametrize("name", EVERY)
def test_a_term_is_explained(name: str):
    """Assert that a term says what it is, and that the page on notation has its coefficients."""
    declared = NOTATION.read_text(encoding="utf-8")
    assert EVERY[name].description
    assert [c for c in {*EVERY[name].link, *EVERY[name].motor} if f"`{c}`" not in declared] == []
