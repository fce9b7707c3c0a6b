"""The flexible joint of eq. (4) and its terms."""

import numpy as np
import pytest

from flexid.analysis.histories import regressors_along
from flexid.errors import SettingError
from flexid.models.flexible_joint import TERMS, flexible_joint, with_stopping_time
from flexid.simulation.free_run import free_run


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


def test_friction_holds_a_joint_at_rest():
    """Assert that with a stopping time a joint hardly creeps under a load it should hold."""
    values = {"theta2": 0.0, "alpha1": 0.0, "alpha_coulomb": 2.0, "beta1": 1.0}
    torque, start = np.full((2000, 1), 0.5), np.zeros(4)
    creeping = flexible_joint(("motor_coulomb",), coulomb_velocity=0.02)
    held = with_stopping_time(flexible_joint(("motor_stiction",)), 0.01, values)
    far = free_run(creeping, values, start, torque, 1e-3)[-1, 2]
    near = free_run(held, {**values, "alpha_holding": 0.0}, start, torque, 1e-3)[-1, 2]
    assert 0 < near < 0.05 * far


def test_friction_at_speed_is_coulomb_s():
    """Assert that a fast motor loses to both kinds of friction the same."""
    values = {"alpha1": 0.0, "theta2": 0.0, "alpha_coulomb": 2.0, "beta1": 1.0}
    torque, start = np.zeros((1000, 1)), np.array([0.0, 0.0, 0.0, 10.0])
    plain = free_run(flexible_joint(("motor_coulomb",)), values, start, torque, 1e-3)
    system = with_stopping_time(flexible_joint(("motor_stiction",)), 0.01, values)
    held = free_run(system, {**values, "alpha_holding": 0.0}, start, torque, 1e-3)
    np.testing.assert_allclose(held, plain, atol=1e-9)


def test_derivative_by_the_stopping_time():
    """Assert that alpha_holding over alpha_coulomb changes ln T, to first order."""
    values = {"alpha1": 30.0, "alpha2": 0.5, "alpha_coulomb": 2.0, "beta1": 1.0}
    system = flexible_joint(("motor_viscous", "motor_stiction"))
    states = np.random.default_rng(5).normal(0.0, 0.02, (50, 4))

    def friction(time: float, holding: float) -> np.ndarray:
        about = with_stopping_time(system, time, values)
        r = regressors_along(about, states, np.full((50, 1), 0.7))["motor"]
        names = about.rows[1].coefficients
        return r[:, names.index("alpha_coulomb")] * 2 + r[:, names.index("alpha_holding")] * holding

    step = 1e-4
    exact = friction(0.01 * np.exp(step), 0.0) - friction(0.01 * np.exp(-step), 0.0)
    linear = friction(0.01, 2.0 * step) - friction(0.01, -2.0 * step)
    np.testing.assert_allclose(linear, exact, atol=1e-8)
