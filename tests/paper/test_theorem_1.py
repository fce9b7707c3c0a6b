"""The bound in the proof of Theorem 1, eqs. (8)-(9)."""

import sympy as sp
from flexible_joint_algebra import c1, c2, f, phi

link_error = sp.Matrix(sp.symbols("e1 e2", real=True))
motor_error = sp.Matrix(sp.symbols("e3 e4", real=True))


def lyapunov() -> sp.Expr:
    """Return V of eq. (8)."""
    return (link_error.dot(link_error) + motor_error.dot(motor_error)) / 2


def test_lyapunov_rate_is_9() -> None:
    """Assert that V' along eq. (7) is minus the two squares of eq. (9)."""
    rate = link_error.dot(-c1 * f * f.dot(link_error)) + motor_error.dot(
        -c2 * phi * phi.dot(motor_error)
    )
    squares = c1 * f.dot(link_error) ** 2 + c2 * phi.dot(motor_error) ** 2
    assert sp.expand(rate + squares) == 0


def test_squared_error_is_bounded_by_twice_the_first_value_of_v() -> None:
    """Assert that the squared error starts at 2 V(0): the printed bound V(0) fails at once."""
    squared_error = link_error.dot(link_error) + motor_error.dot(motor_error)
    assert sp.simplify(squared_error / lyapunov()) == 2
