"""The observer derived for the whole class: Huang (2003), eqs. (2), (3) and (7)."""

import pytest
import sympy as sp
from systems import ALL, NO_CLOSED_FORM, PAPER, THREE_ROWS, UNKNOWN_GAIN, expected_error_dynamics

from flexid.errors import AccelerationError, ModelError
from flexid.models.flexible_joint import flexible_joint
from flexid.models.parametric_system import ParametricSystem, Row
from flexid.paper.observer import derive_observer, error_dynamics


@pytest.mark.parametrize("name", ALL)
def test_error_dynamics_are_equation_7(name: str):
    """Assert that inserting (1) into p̂' leaves -c r rᵀ p̃ for symbolic gains."""
    observer = derive_observer(ALL[name])
    for row, derived in zip(observer.rows, error_dynamics(observer), strict=True):
        for found, wanted in zip(derived, expected_error_dynamics(row), strict=True):
            # At z = 0 alone sign(z) is not |z|/z; simplify needs minutes to see the rest.
            apart = (found - wanted).replace(sp.sign, lambda z: sp.Abs(z) / z)
            assert sp.simplify(sp.expand(apart)) == 0


@pytest.mark.parametrize(
    ("system", "quadratures", "rates"),
    [
        (PAPER, (), []),
        (NO_CLOSED_FORM, ("stribeck",), []),
        (UNKNOWN_GAIN, (), ["u_rate"]),
        (THREE_ROWS, (), ["u2_rate"]),  # of two inputs only the one inside a regressor
    ],
)
def test_what_an_observer_needs_is_reported(system, quadratures, rates):
    """Assert that integrals without an antiderivative, and inputs' rates, are named, no others."""
    observer = derive_observer(system)
    assert observer.quadratures == quadratures
    assert [str(rate) for rate in observer.input_rates] == rates


def test_names_of_the_model_are_left_to_it():
    """Assert that a model may call its own quantities y1, c1 or u_rate."""
    system = ParametricSystem(
        "clash", (Row("arm", "y1", "c1", {"a": "-y1*u", "a_hat": "u_rate"}),), ("u", "u_rate")
    )
    row = derive_observer(system).rows[0]
    assert (str(row.gain), str(row.intermediate[0])) == ("c1_", "y1_")
    assert [str(p) for p in row.estimates] == ["a_hat_", "a_hat_hat"]
    assert str(derive_observer(system).rates[0]) == "u_rate_"


def test_acceleration_is_refused_by_name():
    """Assert that joint damping is refused with row, coefficient, velocity and the way out."""
    with pytest.raises(AccelerationError) as caught:
        derive_observer(flexible_joint(("joint_damping",)))
    error = caught.value
    assert (error.row, error.coefficient, error.velocity) == ("link", "theta_damping", "x4")
    assert "least squares" in str(error)


REST = r"'a' divides by zero at v = 0.*v/\(v\*\*2"
REFUSED: dict[str, str] = dict.fromkeys(("1/v", "q/v**2", "v/abs(v)", "1/sqrt(abs(v))"), REST)
REFUSED |= dict.fromkeys(("sign(q)*v", "sign(u)"), r"jumps with .* smooth it")
REFUSED |= {"q - q": "'a' is 0, so that no motion", "v*2": "'b' is that of 'a', so that no motion"}


@pytest.mark.parametrize("regressor", REFUSED)
def test_what_cannot_be_integrated_is_refused(regressor: str):
    """Assert that a division by the velocity, or a jump with what else moves, is not printed."""
    with pytest.raises(ModelError, match=REFUSED[regressor]):
        derive_observer(
            ParametricSystem("arm", (Row("arm", "q", "v", {"a": regressor, "b": "-2*v"}),))
        )


@pytest.mark.parametrize("regressor", ["q/(1 + v**2)", "1/q", "sign(v)*exp(-(v/0.1)**2)", "u/q*v"])
def test_regressor_with_value_at_rest_is_derived(regressor: str):
    """Assert that other divisions are no concern of the velocity's integral."""
    derive_observer(ParametricSystem("rest", (Row("arm", "q", "v", {"a": regressor}),)))
