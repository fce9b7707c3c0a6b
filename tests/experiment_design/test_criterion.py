"""The criteria E and D, against their definitions."""

import numpy as np
import pytest

from flexid.experiment_design.criterion import deviation, smooth_cost

INFORMATION = np.diag([4.0, 100.0, 1e4])


def test_e_is_the_worst_direction():
    """Assert that E is one over the root of the smallest eigenvalue, in any orientation."""
    turn, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))
    assert deviation(turn @ INFORMATION @ turn.T, "E") == pytest.approx(0.5)


def test_d_is_the_geometric_mean():
    """Assert that D is the geometric mean of the axes of the confidence ellipsoid."""
    assert deviation(INFORMATION, "D") == pytest.approx((0.5 * 0.1 * 0.01) ** (1 / 3))


@pytest.mark.parametrize("criterion", ["E", "D"])
def test_nothing_known_is_infinite_but_searchable(criterion):
    """Assert that a singular matrix determines nothing, and that the search still sees a number."""
    singular = np.diag([1.0, 0.0])
    assert np.isinf(deviation(singular, criterion))
    assert np.isfinite(smooth_cost(singular, criterion))


@pytest.mark.parametrize("criterion", ["E", "D"])
def test_search_sees_the_criterion(criterion):
    """Assert that the smooth cost is the logarithm of the deviation where eigenvalues are apart."""
    exact = np.log(deviation(INFORMATION, criterion))
    assert smooth_cost(INFORMATION, criterion) == pytest.approx(exact, abs=0.01)
