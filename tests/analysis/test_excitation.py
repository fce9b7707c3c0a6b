"""Excitation: (A4) as a matter of degree."""

import numpy as np
import pytest

from flexid.analysis.excitation import excitation
from flexid.models.physical import lumped_coefficients

TABLE_1 = lumped_coefficients(
    gravity_torque=5,
    link_inertia=1,
    joint_stiffness=100,
    motor_inertia=0.3,
    motor_viscous_friction=0.1,
)


def link_regressors(position, acceleration):
    """Regressors of the link row along a motion that obeys it."""
    deflection = -(acceleration + TABLE_1["theta1"] * np.sin(position)) / TABLE_1["theta2"]
    return np.column_stack([-np.sin(position), -deflection])


def sinusoid(amplitude, frequency=5.0):
    """Regressors of the link row along one period of A sin ωt."""
    t = np.linspace(0, 2 * np.pi / frequency, 4000, endpoint=False)
    q = amplitude * np.sin(frequency * t)
    return link_regressors(q, -(frequency**2) * q)


@pytest.mark.parametrize("amplitude", [0.1, 0.2, 0.3])
def test_one_small_sinusoid_confounds_gravity_and_stiffness(amplitude):
    """Assert that the condition number grows as the inverse fourth power of the amplitude.

    sin x1 = x1 - x1³/6 + …: the part of it that is not proportional to x1 has relative size A²,
    and the Gram matrix squares it.
    """
    here = excitation("link", ("theta1", "theta2"), sinusoid(amplitude)).condition_number
    half = excitation("link", ("theta1", "theta2"), sinusoid(amplitude / 2)).condition_number
    assert half / here == pytest.approx(16, rel=0.05)


def test_large_sinusoid_separates_gravity_from_stiffness():
    """Assert that the amplitude of Huang (2003) is well conditioned where 0.3 rad is not."""
    assert excitation("link", ("a", "b"), sinusoid(3.0)).condition_number < 10
    assert excitation("link", ("a", "b"), sinusoid(0.3)).condition_number > 1e5


def test_second_frequency_separates_at_small_amplitude():
    """Assert that a second tone restores excitation that amplitude alone cannot give."""
    t = np.linspace(0, 200, 200_001)
    q = 0.1 * np.sin(5 * t) + 0.02 * np.sin(5 * 2.65 * t)
    a = -0.1 * 25 * np.sin(5 * t) - 0.02 * (5 * 2.65) ** 2 * np.sin(5 * 2.65 * t)
    measured = excitation("link", ("theta1", "theta2"), link_regressors(q, a))
    assert measured.condition_number < 6  # against 1.5e7 without the second tone


def test_dependent_pair_is_named():
    """Assert that two proportional regressors are the confounded pair, and the third is not."""
    t = np.linspace(0, 10, 1001)
    r = np.column_stack([np.sin(t), 3 * np.sin(t), np.cos(t)])
    measured = excitation("row", ("a", "b", "c"), r)
    assert measured.confounded == ("a", "b")
    assert measured.correlated == ("a", "b")
    assert measured.correlation == pytest.approx(1.0, abs=1e-6)
    assert measured.condition_number > 1e12


def test_closed_form_of_two_regressors():
    """Assert that two unit regressors with cosine ρ have singular values 1 ± ρ."""
    r = np.array([[1.0, 0.6], [0.0, 0.8]])
    measured = excitation("row", ("a", "b"), r)
    np.testing.assert_allclose(measured.singular_values, [1.6, 0.4], rtol=1e-12)
    assert measured.correlation == pytest.approx(0.6)
    assert measured.level == pytest.approx(np.linalg.eigvalsh(r.T @ r / 2)[0])


def test_vanishing_regressor_has_no_excitation():
    """Assert that a regressor that is always zero gives an infinite condition number."""
    r = np.column_stack([np.ones(10), np.zeros(10)])
    measured = excitation("row", ("a", "b"), r)
    assert measured.condition_number == float("inf")
    assert measured.confounded == ("b",)


def test_single_coefficient_is_never_confounded():
    """Assert that a row with one coefficient has condition number one and no pair."""
    measured = excitation("row", ("a",), np.arange(1.0, 5.0)[:, None])
    assert measured.condition_number == 1
    assert measured.confounded == ()
