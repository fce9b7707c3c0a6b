"""Signs and brackets of eqs. (3) and (6) of Huang (2003) that give the error dynamics (7).

The equations are written independently of the library's derivation.
"""

import pytest
import sympy as sp

x1, x2, x3, x4, u = sp.symbols("x1 x2 x3 x4 u", real=True)
c1, c2 = sp.symbols("c1 c2", positive=True)
theta = sp.Matrix(sp.symbols("theta1 theta2", real=True))
alpha = sp.Matrix(sp.symbols("alpha1 alpha2", real=True))
beta1 = sp.Symbol("beta1", positive=True)
theta_hat = sp.Matrix(sp.symbols("thetahat1 thetahat2", real=True))
alpha_hat = sp.Matrix(sp.symbols("alphahat1 alphahat2", real=True))

# Eq. (4) in the form of eq. (1).
f = sp.Matrix([-sp.sin(x1), -(x1 - x3)])
phi = sp.Matrix([x1 - x3, -x4])
states = (x1, x2, x3, x4)
rates = (x2, theta.dot(f), x4, alpha.dot(phi) + beta1 * u)

# Eq. (5): terms added to y and z.
link_immersion = sp.Matrix([-c1 * x2 * sp.sin(x1), -c1 * (x1 - x3) * x2])
motor_immersion = sp.Matrix([c2 * (x1 - x3) * x4, -c2 * x4**2 / 2])
ROWS = (
    (c1, f, theta_hat - theta, link_immersion),
    (c2, phi, alpha_hat - alpha, motor_immersion),
)

# The sums of eq. (3) times c1 and c2: rates of the immersions without the row's acceleration.
SUMS = [immersion.jacobian([x1, x3]) * sp.Matrix([x2, x4]) for *_, immersion in ROWS]


def beyond_7(given: list[sp.Matrix]) -> list[sp.Matrix]:
    """Return the rates of both estimates by eq. (5) and given y', z', minus those by eq. (7)."""
    return [
        (rate + immersion.jacobian(states) * sp.Matrix(rates) + gain * r * (r.T * error)).expand()
        for rate, (gain, r, error, immersion) in zip(given, ROWS, strict=True)
    ]


zero = [sp.zeros(2, 1)] * 2
s = theta_hat[0] * sp.sin(x1) + theta_hat[1] * (x1 - x3)
r = alpha_hat[0] * (x1 - x3) - alpha_hat[1] * x4 + beta1 * u


def equation_3(sign: int) -> list[sp.Matrix]:
    """Return y' and z' of eq. (3) with the given sign before the sums."""
    y_rate = -c1 * theta_hat.dot(f) * f
    z_rate = -c2 * (alpha_hat.dot(phi) + beta1 * u) * phi
    return [y_rate - sign * SUMS[0], z_rate - sign * SUMS[1]]


def equation_6(link_gain: sp.Expr, motor_gain: sp.Expr) -> list[sp.Matrix]:
    """Return y' and z' of eq. (6), its second terms multiplied by the given factors."""
    first = -c1 * sp.sin(x1) * s - link_gain * sp.cos(x1) * x2**2
    second = -c1 * (x1 - x3) * s - link_gain * (x2 - x4) * x2
    third = -c2 * (x1 - x3) * r + motor_gain * (x2 - x4) * x4
    return [sp.Matrix([first, second]), sp.Matrix([third, c2 * x4 * r])]


@pytest.mark.parametrize(
    "given", [equation_3(sign=+1), equation_6(link_gain=-c1, motor_gain=-c2)], ids=["(3)", "(6)"]
)
def test_what_gives_7(given: list[sp.Matrix]) -> None:
    """Assert that a plus before the sums of (3), or brackets in (6), gives (7) for any c1, c2."""
    assert beyond_7(given) == zero


def test_minus_before_the_sum_in_3_leaves_twice_the_sum() -> None:
    """Assert that eq. (3) as printed, with a minus sign, differs from eq. (7) by twice the sums."""
    assert beyond_7(equation_3(sign=-1)) == [(2 * one).expand() for one in SUMS]
    assert all(one != zero[0] for one in SUMS)


@pytest.mark.parametrize("gain", [sp.Rational(1, 2), sp.Integer(1), sp.Integer(3)])
def test_6_as_printed_is_wrong_for_every_gain(gain: sp.Expr) -> None:
    """Assert that without brackets eq. (6) differs from (7) by (1 + c) times its second terms."""
    found = beyond_7(equation_6(link_gain=sp.Integer(1), motor_gain=sp.Integer(1)))
    link_miss = sp.Matrix([sp.cos(x1) * x2**2, (x2 - x4) * x2]) * -(1 + gain)
    motor_miss = sp.Matrix([(x2 - x4) * x4, 0]) * (1 + gain)
    assert found[0].subs(c1, gain) == link_miss.expand()
    assert found[1].subs(c2, gain) == motor_miss.expand()
