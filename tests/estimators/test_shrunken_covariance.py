"""Covariance of a few blocks, drawn towards that of white noise."""

import numpy as np
import pytest
from scipy.stats import t

from flexid.estimators.cluster_covariance import shrunken

MIXED = np.random.default_rng(8).standard_normal((6, 6))
WHITE = MIXED @ MIXED.T
"""Covariance of six values for white noise."""


def of_blocks(variances: list[float], blocks: int, rng: np.random.Generator) -> np.ndarray:
    """What some blocks show of a covariance with these variances in six directions."""
    scores = rng.standard_normal((blocks, 6)) * np.sqrt(variances)
    return MIXED @ (scores.T @ scores / blocks) @ MIXED.T


def covered(variances: list[float], blocks: int) -> tuple[np.ndarray, float]:
    """How often 95 % intervals hold each value; and median width beside Student's t alone."""
    rng = np.random.default_rng(11)
    held, widths = [], []
    for _ in range(2000):
        spread = of_blocks(variances, blocks, rng)
        covariance, freedom = shrunken(spread, WHITE, np.full(6, float(blocks)))
        half = t.ppf(0.975, freedom) * np.sqrt(np.diag(covariance))
        error = MIXED @ (rng.standard_normal(6) * np.sqrt(variances))
        held.append(np.abs(error) <= half)
        widths.append(half / (t.ppf(0.975, blocks) * np.sqrt(np.diag(spread))))
    return np.mean(held, axis=0), float(np.median(widths))


@pytest.mark.parametrize("size", [1.0, 9.0])
@pytest.mark.parametrize("blocks", [8, 20])
def test_white_noise_of_any_size_is_covered(size, blocks):
    """Assert that intervals hold 95 % of what white noise does, and are shorter on the whole.

    The factor's floor, which acts where the noise is the sensors' alone, adds a little.
    """
    shares, width = covered([size] * 6, blocks)
    assert 0.94 < shares.mean() < 0.97
    assert shares.min() > 0.93
    assert width < 1.0


@pytest.mark.parametrize("variances", [[25.0, 1, 1, 1, 1, 1], [100.0, 40, 16, 6, 2.5, 1]])
def test_directions_that_differ_keep_their_own(variances):
    """Assert that a noise of few directions is not shared out among all of them."""
    shares, _ = covered(variances, 20)
    assert shares.min() > 0.91
    assert shares.mean() < 0.975


def test_published_formula():
    """Assert shares and values by hand: traces 4 and 10 of two directions, ten blocks."""
    covariance, freedom = shrunken(np.diag([3.0, 1.0]), np.eye(2), np.full(2, 10.0))
    # (0 * 10 + 16) / ((10 + 1 - 1) * (10 - 16 / 2)) = 0.8 towards 2 I
    assert covariance == pytest.approx(np.diag([2.2, 1.8]))
    assert freedom == pytest.approx(1.0 / (0.2**2 / 10.0 + 0.8**2 / 20.0))


def test_units_do_not_matter():
    """Assert that values in other units have the same covariance in these units."""
    spread = of_blocks([25.0, 1, 1, 1, 1, 1], 12, np.random.default_rng(2))
    freedom = np.full(6, 12.0)
    scale = np.diag(10.0 ** np.arange(-3.0, 3.0))
    before, after = (
        shrunken(spread, WHITE, freedom),
        shrunken(scale @ spread @ scale, scale @ WHITE @ scale, freedom),
    )
    assert after[0] == pytest.approx(scale @ before[0] @ scale, rel=1e-6)
    assert after[1] == pytest.approx(before[1], rel=1e-6)


def test_nothing_is_surer_than_the_sensors():
    """Assert that blocks which agree by chance leave what white noise makes."""
    covariance, _ = shrunken(0.1 * WHITE, WHITE, np.full(6, 12.0))
    assert covariance == pytest.approx(WHITE)
    one, freedom = shrunken(np.array([[0.1]]), np.array([[2.0]]), np.array([7.0]))
    assert one == pytest.approx(2.0)
    assert freedom == pytest.approx(7.0)


def test_what_no_block_shows_is_left():
    """Assert that an infinite variance stays, and that the others are drawn without it."""
    spread, white = np.diag([3.0, np.inf, 1.0]), np.diag([1.0, 5.0, 1.0])
    covariance, freedom = shrunken(spread, white, np.array([10.0, 0.0, 10.0]))
    assert np.diag(covariance) == pytest.approx([2.2, np.inf, 1.8])
    assert freedom[1] == 0.0
