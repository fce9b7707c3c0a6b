"""Least squares in which some unknowns must not be negative."""

import numpy as np
import pytest

from flexid.identification.nonnegative import nonnegative_least_squares


def problem(seed, alike):
    """A random problem; its first two columns may be nearly proportional."""
    rng = np.random.default_rng(seed)
    unknowns = int(rng.integers(3, 14))
    matrix = rng.standard_normal((unknowns + 5, unknowns)) * 10.0 ** rng.uniform(-3, 3, unknowns)
    if alike:
        matrix[:, 0] = 2.0 * matrix[:, 1] + 1e-3 * matrix[:, 2]
    return matrix, rng.standard_normal(unknowns + 5), rng.random(unknowns) < 0.7


@pytest.mark.parametrize("alike", [False, True])
@pytest.mark.parametrize("seed", range(50))
def test_no_allowed_change_lowers_the_sum(seed, alike):
    """Assert the conditions of Karush, Kuhn and Tucker, which only the minimum meets."""
    matrix, target, bounded = problem(seed, alike)
    values, misfit = nonnegative_least_squares(matrix, target, bounded)
    residual = target - matrix @ values
    slopes = matrix.T @ residual / np.linalg.norm(matrix, axis=0)
    at_zero = bounded & (values == 0.0)
    assert (values[bounded] >= 0.0).all()
    assert (slopes[at_zero] <= 1e-7).all()
    assert np.abs(slopes[~at_zero]).max(initial=0.0) < 1e-7
    assert misfit == pytest.approx(float(residual @ residual))


def test_a_column_of_zeros_has_no_part():
    """Assert that what no equation contains comes out as zero and does no harm."""
    matrix = np.array([[1.0, 0.0], [2.0, 0.0]])
    values, misfit = nonnegative_least_squares(matrix, np.array([2.0, 4.0]), np.array([True, True]))
    assert values.tolist() == pytest.approx([2.0, 0.0])
    assert misfit == pytest.approx(0.0, abs=1e-25)
