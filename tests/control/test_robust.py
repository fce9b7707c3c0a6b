"""The robust law of Huang (2003), eq. (11)."""

from itertools import pairwise
from typing import Any

import pytest
import sympy as sp

from flexid.control.controller import REFERENCE_NAMES
from flexid.control.laws import robust_law
from flexid.derivation.symbolic import symbol, to_sympy
from flexid.errors import ExpressionError, ModelError

LAW = robust_law()
QD = [symbol(name) for name in REFERENCE_NAMES]


def definition(name: str) -> sp.Expr:
    """Return a definition of the law with all others inserted."""
    names = {*LAW.values, *LAW.definitions, *REFERENCE_NAMES, "x1", "x2", "x3", "x4"}
    value = to_sympy(LAW.definitions[name], names)
    for other in reversed(list(LAW.definitions)):
        value = value.subs(symbol(other), to_sympy(LAW.definitions[other], names))
    return value


def rate(expression: sp.Expr) -> sp.Expr:
    """Return the time derivative of a function of the reference."""
    return sp.Add(*(sp.diff(expression, a) * b for a, b in pairwise(QD)))


def test_nominal_speed_is_rate_of_nominal_position() -> None:
    """Assert that w2N = w1N'."""
    assert sp.expand(definition("w2N") - rate(definition("w1N"))) == 0


def test_nominal_input_moves_the_nominal_motor() -> None:
    """Assert that uN = Jr w2N' + mu w2N + ke (w1N - qd), with nominal values."""
    inertia = symbol("nominal_motor_inertia")
    friction = symbol("nominal_motor_viscous_friction")
    stiffness = symbol("nominal_joint_stiffness")
    torque = inertia * rate(definition("w2N")) + friction * definition("w2N")
    torque += stiffness * (definition("w1N") - QD[0])
    assert sp.expand(definition("uN") - torque) == 0


@pytest.mark.parametrize(
    ("exponents", "gains"),
    [((1, 2, 3), (7 / 6, 2500.0, 52500.0)), ((1, 1, 0), (7 / 6, 50.0, 0.42))],
)
def test_gains_of_table_1(
    exponents: tuple[float, float, float], gains: tuple[float, float, float]
) -> None:
    """Assert that the exponents make the gains k^a JlM/kem, k^b, k^c JrM."""
    values = robust_law(exponents=exponents).values
    assert [values[f"gain{i}"] for i in (1, 2, 3)] == pytest.approx(gains, rel=1e-14)


@pytest.mark.parametrize(
    ("name", "value"), [("k", 10.0), ("largest_link_inertia", 3.0), ("largest_motor_inertia", 0.1)]
)
def test_gains_follow_the_parameters(name: str, value: float) -> None:
    """Assert that a law with another parameter has the gains of a law that was made with it."""
    changed = robust_law().with_parameters(**{name: value})
    made: dict[str, Any] = {name: value}
    assert changed.values == robust_law(**made).values
    assert changed.values != robust_law().values


def test_gains_cannot_be_set_beside_what_they_follow_from() -> None:
    """Assert that whoever sets a gain learns which parameters decide it."""
    with pytest.raises(ModelError, match=r"gain2 = k\*\*2.0 from its parameters: change those"):
        robust_law().with_parameters(gain2=1.0)


def test_gains_without_value_are_refused() -> None:
    """Assert that a gain that overflows names the values that it follows from."""
    with pytest.raises(ExpressionError, match=r"gain2.*no finite value for .*k = 1e\+200"):
        robust_law(k=1e200).values  # noqa: B018
