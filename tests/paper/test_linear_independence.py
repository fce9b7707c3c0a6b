"""(A4) along the steady state, eqs. (12)-(14): why sin x1 and x1 - x3 are independent."""

import numpy as np
import pytest
import sympy as sp

from flexid.estimators.excitation import excitation

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
