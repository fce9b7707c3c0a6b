"""Which part of a regressor a filter can take as it stands."""

import sympy as sp
from systems import NO_CLOSED_FORM, THREE_ROWS

from flexid.derivation.regressor_classes import filter_functions, split_regressor
from flexid.derivation.symbolic import symbol, symbolic_system
from flexid.models.flexible_joint import TERMS, flexible_joint

JOINT = symbolic_system(flexible_joint(TERMS))
X1, X2, X3, X4, U = (symbol(name) for name in ("x1", "x2", "x3", "x4", "u"))


def emitted(system, name):
    """A constant of the generated module, read back from its source."""
    lines = filter_functions(system, "Test").splitlines()
    return next(line.split(" = ")[1] for line in lines if line.startswith(f"{name} = "))


def test_positions_and_inputs_are_memoryless():
    """Assert that a function of positions and the input is filtered as it stands."""
    parts = split_regressor(sp.sin(X1) * X3 + U**2, JOINT)
    assert parts.memoryless == sp.sin(X1) * X3 + U**2
    assert parts.remainder == 0
    assert parts.velocity_factors == (0, 0)


def test_a_sum_with_velocities_is_split_row_by_row():
    """Assert that the joint's damping becomes the factors 1 and -1 of the two velocities."""
    parts = split_regressor(3 * X1 + X2 - X4, JOINT)
    assert parts.velocity_factors == (1, -1)
    assert parts.memoryless == 3 * X1
    assert parts.remainder == 0


def test_a_product_with_a_velocity_needs_the_velocity():
    """Assert that velocity times position is no derivative the filter could take."""
    parts = split_regressor(X2 * sp.cos(X1) + X2 * (X1 + 1), JOINT)
    assert parts.remainder == X2 * sp.cos(X1) + X1 * X2
    assert parts.velocity_factors == (1, 0)


def test_a_bracket_is_opened_before_the_split():
    """Assert that (x1 + x2)**2 loses its memoryless square to the filter."""
    parts = split_regressor((X1 + X2) ** 2, JOINT)
    assert parts.memoryless == X1**2
    assert parts.remainder == 2 * X1 * X2 + X2**2


def test_dependence_on_the_input_is_seen():
    """Assert that the hold of the input is heeded exactly where an input occurs."""
    assert split_regressor(X1 * U, JOINT).depends_on_input
    assert not split_regressor(X1 - X3, JOINT).depends_on_input


def test_the_paper_needs_no_velocity():
    """Assert that eq. (4) with unknown input gain is estimated from positions alone."""
    assert emitted(flexible_joint(), "VELOCITY_NEEDED") == "()"


def test_coefficients_that_need_velocities_are_named():
    """Assert that Coulomb friction is what needs a velocity among all terms of the joint."""
    needed = emitted(flexible_joint(TERMS), "VELOCITY_NEEDED")
    assert needed == "('theta_coulomb', 'alpha_coulomb')"


def test_a_known_part_counts_as_a_signal():
    """Assert that a known part with the input is held like a regressor with the input."""
    assert emitted(NO_CLOSED_FORM, "HELD") == "(False, False, False, True)"


def test_any_number_of_rows():
    """Assert that three rows give one signal per coefficient and one known part per row."""
    assert emitted(THREE_ROWS, "N_SIGNALS") == str(len(THREE_ROWS.coefficients) + 3)
