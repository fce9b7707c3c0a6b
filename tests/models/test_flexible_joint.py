"""The flexible joint of eq. (4) and its terms."""

import numpy as np
import pytest

from flexid.analysis.histories import regressors_along
from flexid.errors import SettingError
from flexid.models.flexible_joint import SHAPE_TERMS, TERMS, TIES, flexible_joint
from flexid.models.terms import with_dry_friction


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


def test_order_of_terms_does_not_matter():
    """Assert that the same terms in another order declare the same model."""
    one, other = (
        flexible_joint(("gravity", "link_viscous")),
        flexible_joint(("link_viscous", "gravity")),
    )
    assert one.digest == other.digest


def test_spring_torque_acts_and_reacts():
    """Assert that every joint term enters the two rows with opposite signs."""
    for term in ("joint_damping", "cubic_stiffness"):
        (link,), (motor,) = TERMS[term].link.values(), TERMS[term].motor.values()
        assert link in (f"-{motor}", f"-({motor})")


@pytest.mark.parametrize(
    ("terms", "known", "word"), [(("magnets",), {}, "magnets"), ((), {"beta2": 1.0}, "beta2")]
)
def test_unknown_terms_and_coefficients(terms: tuple[str, ...], known: dict[str, float], word: str):
    """Assert that a misspelled term or known coefficient is named, with the known ones."""
    with pytest.raises(SettingError, match=word):
        flexible_joint(terms, known)


def test_smoothing_is_a_constant_only_where_there_is_friction():
    """Assert that models without Coulomb friction keep the constants they had."""
    assert flexible_joint(coulomb_velocity=0.02).constants == {}
    assert flexible_joint(("motor_coulomb",), coulomb_velocity=0.02).constants == {
        "coulomb_velocity": 0.02
    }


@pytest.mark.parametrize("velocity", [0.0, -0.1, float("nan"), float("inf")])
def test_impossible_smoothing(velocity: float):
    """Assert that a Coulomb velocity that divides by zero or smooths everything is refused."""
    with pytest.raises(SettingError, match="coulomb_velocity"):
        flexible_joint(("motor_coulomb",), coulomb_velocity=velocity)


def test_dry_friction_is_the_sign_of_its_row_s_velocity():
    """Assert that dry friction takes the place of the smoothed one, and of nothing else."""
    smooth = flexible_joint(("motor_coulomb", "link_coulomb", "motor_viscous"))
    dry = with_dry_friction(smooth)
    link, motor = dry.rows
    assert (link.regressors["theta_coulomb"], motor.regressors["alpha_coulomb"]) == (
        "-sign(x2)",
        "-sign(x4)",
    )
    assert dry.constants == {}
    others = set(smooth.coefficients) - {"theta_coulomb", "alpha_coulomb"}
    for row, before in zip(dry.rows, smooth.rows, strict=True):
        for name in others & set(row.coefficients):
            assert row.regressors[name] == before.regressors[name]


@pytest.mark.parametrize("term", SHAPE_TERMS)
def test_shape_terms_of_the_spring_are_tied(term: str):
    """Assert that what acts on both sides of the spring is one torque over each side's inertia."""
    declared = SHAPE_TERMS[term]
    if not (declared.link and declared.motor):
        return
    for name, regressor in declared.link.items():
        source, upper, lower = TIES[name]
        assert (upper, lower) == ("theta2", "alpha1")
        model = flexible_joint((term,))
        point = {n: 0.1 * (i + 1) for i, n in enumerate(model.states)}
        states = np.array([list(point.values())])
        regressors = regressors_along(model, states, np.zeros((1, 1)))
        here = regressors["link"][0, model.rows[0].coefficients.index(name)]
        there = regressors["motor"][0, model.rows[1].coefficients.index(source)]
        assert here == pytest.approx(-there), regressor
