"""Estimates: parts of them, and what widens them."""

import numpy as np

from flexid.identification.vocabulary.estimate import Estimate

COVARIANCE = np.array([[4.0, 1.0, 0.0], [1.0, 9.0, 0.0], [0.0, 0.0, np.inf]])
ESTIMATE = Estimate(("a", "b", "c"), np.array([1.0, 2.0, 3.0]), COVARIANCE, (5.0, 7.0, 0.0))


def test_widening_adds_covariances_and_scaling_keeps_correlations():
    """Assert both, that values and freedom stay, and that what is free stays so, uncorrelated."""
    assert ESTIMATE.deviations.tolist() == [2.0, 3.0, np.inf]
    for more in (2.0, np.nan_to_num(np.inf)):
        found = ESTIMATE.widened(np.array([[1.0, 0.5, more], [0.5, 2.0, more], [more] * 3]))
        assert found.covariance[:2, :2].tolist() == [[5.0, 1.5], [1.5, 11.0]]
        assert found.covariance[2].tolist() == [0.0, 0.0, np.inf]
        assert found.values is ESTIMATE.values
        assert found.degrees_of_freedom == ESTIMATE.degrees_of_freedom
    found = ESTIMATE.scaled(np.array([2.0, 3.0, 5.0]))
    assert found.deviations.tolist() == [4.0, 9.0, np.inf]
    assert found.covariance[0, 1] == 6.0
    assert found.covariance[2, :2].tolist() == [0.0, 0.0]


def test_values_by_name():
    """Assert that what was sought goes before what was given."""
    assert ESTIMATE.by_name == {"a": 1.0, "b": 2.0, "c": 3.0}
    assert ESTIMATE.with_values({"a": 9.0, "d": 4.0}) == {"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0}
