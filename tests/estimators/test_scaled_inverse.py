"""The least of a quadratic form beside values that are zero, on made-up forms."""

import numpy as np
import pytest

from flexid.estimators.normal_equations import least_with


def test_the_rest_follows_what_is_zero():
    """Assert that the form's gradient vanishes where values are sought, whatever their units."""
    rng = np.random.default_rng(5)
    factor = rng.normal(size=(5, 5)) * np.array([1e-3, 1.0, 1e3, 10.0, 1.0])
    matrix, values = factor.T @ factor, rng.normal(size=5)
    left = np.array([True, False, True, True, False])
    found = least_with(left, matrix, values)
    whole = np.zeros(5)
    whole[left] = found.values
    gradient = matrix @ (whole - values)
    scale = np.abs(matrix) @ np.abs(values)
    assert np.abs(gradient[left] / scale[left]).max() < 1e-10
    assert np.abs(gradient[~left] / scale[~left]).max() > 1e-3
    part = matrix[np.ix_(left, left)]
    units = np.sqrt(np.outer(np.diag(part), np.diag(part)))
    assert (found.inverse * units) @ (part / units) == pytest.approx(np.eye(3), abs=1e-10)
    assert not found.free.any()


def test_nothing_moves_along_an_open_direction():
    """Assert that of two values whose sum alone counts each takes half of what the third leaves.

    Their difference stays what it was, and both are free.
    """
    columns = np.array([[1.0, 1.0, 1.0], [0.0, 0.0, 2.0]])
    values = np.array([1.0, 3.0, 0.5])
    found = least_with(np.array([True, True, False]), columns.T @ columns, values)
    assert found.values == pytest.approx([1.25, 3.25])
    assert found.free.tolist() == [True, True]


def test_without_zeros_all_stays():
    """Assert that values stay where they are, those of which the form knows nothing as well."""
    values = np.array([2.0, 7.0])
    found = least_with(np.array([True, True]), np.diag([4.0, 0.0]), values)
    assert found.values.tolist() == [2.0, 7.0]
    assert found.free.tolist() == [False, True]
