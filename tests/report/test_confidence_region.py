"""Joint confidence regions, by coverage and by what their chart shows."""

import numpy as np
import pytest

from flexid.identification.vocabulary.estimate import Estimate
from flexid.report.identification_charts import confidence_region


def made(
    values: np.ndarray,
    covariance: np.ndarray,
    names: tuple[str, ...] = ("a", "b", "c"),
    degrees_of_freedom: tuple[float, ...] = (9.0, 12.0, 20.0),
) -> Estimate:
    """A fit of which only the result is known."""
    return Estimate(names, values, covariance, degrees_of_freedom)


def fit(correlation: float = 0.9) -> Estimate:
    """Three coefficients of which the first two correlate."""
    deviations = np.array([0.1, 2.0, 30.0])
    correlations = np.eye(3)
    correlations[0, 1] = correlations[1, 0] = correlation
    correlations[1, 2] = correlations[2, 1] = -0.3
    return made(np.array([1.0, -5.0, 100.0]), correlations * np.outer(deviations, deviations))


def test_the_region_holds_the_truth_in_95_percent():
    """Assert the nominal coverage where the covariance is estimated with 9 degrees of freedom.

    A share of 4000 draws has a standard error of 0.35 %.
    """
    generator = np.random.default_rng(2)
    root = np.array([[1.0, 0.0], [4.0, 0.5]])
    held = 0
    for _ in range(4000):
        values = root @ generator.standard_normal(2)
        samples = root @ generator.standard_normal((2, 9))
        drawn = made(values, samples @ samples.T / 9.0, ("a", "b"), (9.0, 9.0))
        region = confidence_region(drawn, ("a", "b"))
        assert region is not None
        # The truth is zero: inside if the boundary winds about it.
        angles = np.unwrap(np.arctan2(region.boundary[1], region.boundary[0]))
        held += abs(angles[-1] - angles[0]) > np.pi
    assert 0.94 < held / 4000 < 0.96


def test_the_boundary_is_an_ellipse_of_the_covariance():
    """Assert that all points of it are equally far from the centre, measured by the covariance."""
    found = fit()
    region = confidence_region(found, ("a", "b"))
    assert region is not None
    apart = region.boundary - region.centre[:, None]
    distances = np.einsum("in,ij,jn->n", apart, np.linalg.inv(found.covariance[:2, :2]), apart)
    assert distances == pytest.approx(np.full(distances.shape, distances[0]))
    assert region.correlation == pytest.approx(0.9)


def test_an_exact_correlation_is_a_line():
    """Assert that two values that move together without play have a region without width."""
    region = confidence_region(fit(correlation=1.0), ("a", "b"))
    assert region is not None
    apart = region.boundary - region.centre[:, None]
    assert apart[1] == pytest.approx(20.0 * apart[0])
