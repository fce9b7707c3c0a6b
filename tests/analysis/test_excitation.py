"""Excitation: (A4) as a matter of degree."""

import numpy as np
import pytest

from flexid.analysis.excitation import excitation


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
