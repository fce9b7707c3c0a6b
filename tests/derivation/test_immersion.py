"""The immersion of a regressor, and the signals that filters need of it."""

import math
from typing import Any

import pytest
import sympy as sp
from scipy.integrate import quad
from systems import NO_CLOSED_FORM, THREE_ROWS

from flexid.derivation.model_functions import signal_module, split_regressor
from flexid.derivation.source import ScalarPrinter
from flexid.derivation.symbolic import symbol, symbolic_system, to_sympy
from flexid.errors import ExpressionError
from flexid.models.flexible_joint import TERMS, flexible_joint
from flexid.paper.observer import immersion

q, v, width = symbol("q"), symbol("v"), symbol("width")

CLOSED = {
    "1": "v",
    "q": "q*v",
    "-v": "-v**2/2",
    "(q + v)**2": "q**2*v + q*v**2 + v**3/3",
    "sign(v)": "Abs(v)",
    "v*abs(v)": "v**2*Abs(v)/3",
    "tanh(10*v)": "LogCosh(10*v)/10",
    "tanh(v/width)*q": "q*width*LogCosh(v/width)",
    "tanh(v + q)*q": "q*(-LogCosh(q) + LogCosh(q + v))",
}

QUADRATURE = ["exp(-v**2)*tanh(v)", "cos(q*v)", "tanh(q*v)", "v/abs(q - v)"]


@pytest.mark.parametrize("text", CLOSED)
def test_closed_form(text: str):
    """Assert the antiderivative found by hand, and the value of its integral."""
    regressor = to_sympy(text, {"q", "v", "width"})
    found = immersion(regressor, v, [width])
    assert str(found) == CLOSED[text]
    values: dict[Any, Any] = {q: 0.7, width: 0.3}
    printed = sp.lambdify(v, found.subs(values), "math", printer=ScalarPrinter)
    integrand = sp.lambdify(v, regressor.subs(values), "math")
    for end in (-300.0, -2.5, -1e-3, 0.0, 1e-3, 2.5, 300.0):
        breaks = sorted(math.copysign(p, end) for p in (1.0, 10.0, 100.0) if p < abs(end))
        wanted, _ = quad(integrand, 0.0, end, points=breaks or None, epsabs=1e-12, epsrel=1e-10)
        assert printed(end) == pytest.approx(wanted, rel=1e-9, abs=1e-11)


@pytest.mark.parametrize("text", QUADRATURE)
def test_quadrature_where_no_plain_closed_form(text: str):
    """Assert that a regressor without a closed form that is valid everywhere stays an integral."""
    assert immersion(to_sympy(text, {"q", "v"}), v).has(sp.Integral)


@pytest.mark.parametrize(
    "text", ["1/0", "q/0", "0/0*q", "q**(1/0)", "sqrt(-1)*q", "(-8)**(1/3)", "tan(pi/2) + q"]
)
def test_no_finite_real_value(text: str):
    """Assert that an expression without any finite real value is refused with its place."""
    with pytest.raises(ExpressionError, match=r"here: .*no finite real value"):
        to_sympy(text, {"q"}, "here")


JOINT = symbolic_system(flexible_joint(TERMS))
X1, X2, X3, X4, U = (symbol(name) for name in ("x1", "x2", "x3", "x4", "u"))


PARTS = {
    "positions and inputs": (sp.sin(X1) * X3 + U**2, sp.sin(X1) * X3 + U**2, (0, 0), 0),
    "the joint's damping": (3 * X1 + X2 - X4, 3 * X1, (1, -1), 0),
    "a product": (X2 * sp.cos(X1) + X2 * (X1 + 1), 0, (1, 0), X2 * sp.cos(X1) + X1 * X2),
    "a bracket": ((X1 + X2) ** 2, X1**2, (0, 0), 2 * X1 * X2 + X2**2),
}
"""Regressor; by hand its memoryless part, factors of velocities, and the remainder."""


@pytest.mark.parametrize("case", PARTS)
def test_parts(case):
    """Assert that a regressor is split, term by term, by its dependence on velocities."""
    regressor, *expected = PARTS[case]
    parts = split_regressor(regressor, JOINT)
    assert [parts.memoryless, parts.velocity_factors, parts.remainder] == expected


@pytest.mark.parametrize(
    ("system", "name", "value"),
    [
        (flexible_joint(), "VELOCITY_NEEDED", "()"),
        (flexible_joint(TERMS), "VELOCITY_NEEDED", "('theta_coulomb', 'alpha_coulomb')"),
        (NO_CLOSED_FORM, "HELD", "(False, False, False, True)"),  # the known part has an input
        (THREE_ROWS, "N_SIGNALS", str(len(THREE_ROWS.coefficients) + 3)),
    ],
)
def test_what_is_emitted(system, name, value):
    """Assert that velocities are required only if needed, and the hold only if it matters."""
    lines = signal_module(system).splitlines()
    assert f"{name} = {value}" in lines
