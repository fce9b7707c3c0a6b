"""Which signs and brackets of eqs. (3) and (6) give the error dynamics (7), and which do not."""

import pytest
import sympy as sp
from flexible_joint_algebra import (
    alpha_hat,
    beta1,
    c1,
    c2,
    f,
    link_error_rate,
    link_immersion,
    motor_error_rate,
    motor_immersion,
    phi,
    theta_hat,
    u,
    x1,
    x2,
    x3,
    x4,
)

zero = sp.zeros(2, 1)
s = theta_hat[0] * sp.sin(x1) + theta_hat[1] * (x1 - x3)
r = alpha_hat[0] * (x1 - x3) - alpha_hat[1] * x4 + beta1 * u

# The sums of eq. (3) times c1 and c2: the immersions' rates without the row's own acceleration.
link_cancelling = link_immersion.jacobian([x1, x3]) * sp.Matrix([x2, x4])
motor_cancelling = motor_immersion.jacobian([x1, x3]) * sp.Matrix([x2, x4])


def equation_3(sign: int) -> tuple[sp.Matrix, sp.Matrix]:
    """Return y' and z' of eq. (3) with the given sign before the sums."""
    return (
        -c1 * theta_hat.dot(f) * f - sign * link_cancelling,
        -c2 * (alpha_hat.dot(phi) + beta1 * u) * phi - sign * motor_cancelling,
    )


def equation_6(link_gain: sp.Expr, motor_gain: sp.Expr) -> tuple[sp.Matrix, sp.Matrix]:
    """Return y' and z' of eq. (6), its second terms multiplied by the given factors."""
    y_rate = sp.Matrix(
        [
            -c1 * sp.sin(x1) * s - link_gain * sp.cos(x1) * x2**2,
            -c1 * (x1 - x3) * s - link_gain * (x2 - x4) * x2,
        ]
    )
    z_rate = sp.Matrix([-c2 * (x1 - x3) * r + motor_gain * (x2 - x4) * x4, c2 * x4 * r])
    return y_rate, z_rate


def test_plus_before_the_sum_in_3_gives_7() -> None:
    """Assert that eq. (3) with a plus sign before the sums gives eq. (7) for any c1, c2."""
    y_rate, z_rate = equation_3(sign=+1)
    assert link_error_rate(y_rate) == zero
    assert motor_error_rate(z_rate) == zero


def test_minus_before_the_sum_in_3_leaves_twice_the_sum() -> None:
    """Assert that eq. (3) as printed, with a minus sign, misses eq. (7) by twice the sums."""
    y_rate, z_rate = equation_3(sign=-1)
    assert link_error_rate(y_rate) == (2 * link_cancelling).applyfunc(sp.expand) != zero
    assert motor_error_rate(z_rate) == (2 * motor_cancelling).applyfunc(sp.expand) != zero


def test_outer_brackets_in_6_give_7() -> None:
    """Assert that eq. (6) with its gain before the whole of each line gives eq. (7)."""
    y_rate, z_rate = equation_6(link_gain=-c1, motor_gain=-c2)
    assert link_error_rate(y_rate) == zero
    assert motor_error_rate(z_rate) == zero


@pytest.mark.parametrize("gain", [sp.Rational(1, 2), sp.Integer(1), sp.Integer(3)])
def test_6_as_printed_is_wrong_for_every_gain(gain: sp.Expr) -> None:
    """Assert that without brackets eq. (6) misses eq. (7) by (1 + c) times its second terms.

    Not even Table I's c1 = c2 = 1 helps: there the lost bracket costs the sign.
    """
    y_rate, z_rate = equation_6(link_gain=sp.Integer(1), motor_gain=sp.Integer(1))
    link_miss = sp.Matrix([sp.cos(x1) * x2**2, (x2 - x4) * x2]) * -(1 + gain)
    motor_miss = sp.Matrix([(x2 - x4) * x4, 0]) * (1 + gain)
    assert link_error_rate(y_rate).subs(c1, gain) == link_miss.applyfunc(sp.expand)
    assert motor_error_rate(z_rate).subs(c2, gain) == motor_miss.applyfunc(sp.expand)
