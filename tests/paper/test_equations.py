"""Huang (2003): signs of eqs. (3) and (6) that give (7), and (A4) along the steady state.

The equations are written independently of the library's derivation.
"""

import numpy as np
import pytest
import sympy as sp

from flexid.estimators.excitation import excitation

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


# (A4), eqs. (12)-(14): why sin x1 and x1 - x3 are independent.
theta1, theta2 = 5.0, 100.0


def condition_number(amplitude: float, second_tone: float = 0.0) -> float:
    """Return the condition number of the normalised Gram matrix of f along a periodic motion.

    The motion is A sin 5t, with a second tone at 13.25 rad/s (2.65 times the first) of the given
    share of its amplitude; x1 - x3 follows from the link's row of eq. (4).
    """
    time = np.linspace(0.0, 8 * np.pi, 80_000, endpoint=False)  # periods of both tones
    link = amplitude * (np.sin(5.0 * time) + second_tone * np.sin(13.25 * time))
    acceleration = -amplitude * (
        25.0 * np.sin(5.0 * time) + second_tone * 13.25**2 * np.sin(13.25 * time)
    )
    deflection = -(acceleration + theta1 * np.sin(link)) / theta2
    basis = np.column_stack((-np.sin(link), -deflection))
    return excitation("link", ("theta1", "theta2"), basis).condition_number


def test_what_follows_from_dependence() -> None:
    """Assert a free pendulum, and not eq. (12), which integrates over x1 instead of over time."""
    time, factor = sp.symbols("t K")
    x1 = sp.Function("x1")(time)
    x2 = x1.diff(time)
    printed = factor * sp.cos(x1)
    assert sp.expand(printed.diff(time) - (-factor * sp.sin(x1) * x2)) == 0
    assert sp.expand(printed.diff(time) - (-factor * sp.sin(x1))) != 0
    x1, x3, a, gravity, spring = sp.symbols("x1 x3 a theta1 theta2")
    row = -gravity * sp.sin(x1) - spring * (x1 - x3)
    dependent = row.subs(x3, x1 - a * sp.sin(x1))
    assert sp.expand(dependent + (gravity + a * spring) * sp.sin(x1)) == 0


def test_a_sinusoid_is_no_pendulum_motion() -> None:
    """Assert a third harmonic A^3/24 K, and along a sine an odd deflection and an even x4."""
    phase = sp.Symbol("s", real=True)
    amplitude, factor, w = sp.symbols("A K w", positive=True)
    motion = amplitude * sp.sin(phase)
    residual = -(w**2) * motion + factor * (motion - motion**3 / 6)  # sin x1 to third order
    harmonic = sp.integrate(sp.expand(residual * sp.sin(3 * phase)), (phase, 0, 2 * sp.pi)) / sp.pi
    assert sp.simplify(harmonic - factor * amplitude**3 / 24) == 0
    time = sp.Symbol("t", real=True)
    amplitude, w, gravity, spring = sp.symbols("A w theta1 theta2", positive=True)
    x1 = amplitude * sp.sin(w * time)
    deflection = -(x1.diff(time, 2) + gravity * sp.sin(x1)) / spring
    x4 = (x1 - deflection).diff(time)
    assert sp.simplify(deflection + deflection.subs(time, -time)) == 0
    assert sp.simplify(x4 - x4.subs(time, -time)) == 0
    assert x4.subs(time, 0) != 0


@pytest.mark.parametrize(("amplitude", "expected"), [(0.3, 1.8e5), (3.0, 5.8)])
def test_condition_number_of_one_sinusoid(amplitude: float, expected: float) -> None:
    """Assert the condition number of theta1 and theta2 for one tone of 5 rad/s, two amplitudes."""
    assert condition_number(amplitude) == pytest.approx(expected, rel=0.02)


def test_condition_number_grows_with_the_fourth_power_of_a_small_amplitude() -> None:
    """Assert that halving a small amplitude makes the condition number 16 times larger."""
    amplitudes = np.array([0.05, 0.1, 0.2])
    conditions = [condition_number(amplitude) for amplitude in amplitudes]
    slope = np.polyfit(np.log(amplitudes), np.log(conditions), 1)[0]
    assert slope == pytest.approx(-4.0, abs=0.03)


@pytest.mark.parametrize("amplitude", [0.01, 0.1, 1.0])
def test_a_second_tone_separates_the_coefficients_at_any_amplitude(amplitude: float) -> None:
    """Assert that a tone of a fifth of the amplitude, 2.65 times the frequency, gives 5."""
    assert condition_number(amplitude, second_tone=0.2) == pytest.approx(5.0, rel=0.05)
