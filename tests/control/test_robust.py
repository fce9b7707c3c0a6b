"""The robust law of Huang (2003), eq. (11)."""

from itertools import pairwise

import pytest
import sympy as sp

from flexid.control.controller import REFERENCE_NAMES
from flexid.control.robust import robust_law
from flexid.derivation.symbolic import symbol, to_sympy

LAW = robust_law()
QD = [symbol(name) for name in REFERENCE_NAMES]


def definition(name: str) -> sp.Expr:
    """Return a definition of the law with all others inserted."""
    names = {*LAW.parameters, *LAW.definitions, *REFERENCE_NAMES, "x1", "x2", "x3", "x4"}
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
    values = robust_law(exponents=exponents).parameters
    assert [values[f"gain{i}"] for i in (1, 2, 3)] == pytest.approx(gains, rel=1e-14)
