"""The test for white residuals, on noise of which it is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from flexid.estimators.whiteness import whiteness


def projected(noise: np.ndarray) -> np.ndarray:
    """What a fit of a cubic to each column leaves."""
    cubic, _ = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, len(noise)), 4))
    return noise - cubic @ (cubic.T @ noise)


def test_white_noise_fails_as_often_as_the_level_says():
    """Assert that residuals of white noise are below the 5 % level in 2 to 9 % of 400 cases.

    The binomial standard error is 1.1 %.
    """
    generator = np.random.default_rng(4)
    low = []
    for _ in range(400):
        parts = [projected(generator.standard_normal((300, 2))) for _ in range(10)]
        low.append(whiteness(parts, 10 * 2 * 4) < 0.05)
    assert 0.02 <= np.mean(low) <= 0.09


@pytest.mark.parametrize("rho", [0.1, 0.9, -0.3])
def test_correlated_noise_is_found(rho):
    """Assert that even weak correlation from sample to sample is found in 6000 residuals."""
    shocks = np.random.default_rng(6).standard_normal((6000, 1))
    noise = np.asarray(lfilter([1.0], [1.0, -rho], shocks, axis=0))
    assert whiteness([noise[:3000], noise[3000:]], 8) < 1e-3


def test_no_residual_at_all():
    """Assert that residuals that are all zero count as white."""
    assert whiteness([np.zeros((50, 2))], 4) == 1.0
