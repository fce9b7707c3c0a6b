"""Which part of a regressor a filter can take as it stands."""

import pytest
import sympy as sp
from systems import NO_CLOSED_FORM, THREE_ROWS

from flexid.derivation.regressor_classes import signal_module, split_regressor
from flexid.derivation.symbolic import symbol, symbolic_system
from flexid.models.flexible_joint import TERMS, flexible_joint

JOINT = symbolic_system(flexible_joint(TERMS))
X1, X2, X3, X4, U = (symbol(name) for name in ("x1", "x2", "x3", "x4", "u"))


PARTS = {
    "positions and inputs": (sp.sin(X1) * X3 + U**2, sp.sin(X1) * X3 + U**2, (0, 0), 0),
    "the joint's damping": (3 * X1 + X2 - X4, 3 * X1, (1, -1), 0),
    "a product": (X2 * sp.cos(X1) + X2 * (X1 + 1), 0, (1, 0), X2 * sp.cos(X1) + X1 * X2),
    "a bracket": ((X1 + X2) ** 2, X1**2, (0, 0), 2 * X1 * X2 + X2**2),
}
"""What is filtered as it stands, factors of velocities, and what needs a velocity, by hand."""


@pytest.mark.parametrize("case", PARTS)
def test_parts(case):
    """Assert that a regressor is split, term by term, by its dependence on velocities."""
    regressor, *expected = PARTS[case]
    parts = split_regressor(regressor, JOINT)
    assert [parts.memoryless, parts.velocity_factors, parts.remainder] == expected


def test_dependence_on_the_input_is_seen():
    """Assert that the hold of the input is heeded exactly where an input occurs."""
    assert split_regressor(X1 * U, JOINT).depends_on_input
    assert not split_regressor(X1 - X3, JOINT).depends_on_input


@pytest.mark.parametrize(
    ("system", "name", "value"),
    [
        (flexible_joint(), "VELOCITY_NEEDED", "()"),
        (flexible_joint(TERMS), "VELOCITY_NEEDED", "('theta_coulomb', 'alpha_coulomb')"),
        (NO_CLOSED_FORM, "HELD", "(False, False, False, True)"),  # the known part has the input
        (THREE_ROWS, "N_SIGNALS", str(len(THREE_ROWS.coefficients) + 3)),
    ],
)
def test_what_is_emitted(system, name, value):
    """Assert that velocities are asked for where they are needed, and the hold where it counts."""
    lines = signal_module(system).splitlines()
    assert f"{name} = {value}" in lines
