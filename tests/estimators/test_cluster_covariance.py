"""Covariance from few blocks, against closed forms and brute force."""

import numpy as np
import pytest

from flexid.estimators.cluster_covariance import Clusters, cluster_influences

LENGTHS = (40, 25, 60, 30, 45)
SEGMENTS = np.array([0, 0, 1, 1, 1])
OWN, COMMON = 2, 3


def derivatives(seed: int = 0) -> list[np.ndarray]:
    """Derivatives block by block, of very different sizes: two unknowns own, three common."""
    generator = np.random.default_rng(seed)
    sizes = np.array([1.0, 30.0, 1e-3, 5.0, 1e4])
    return [sizes * generator.normal(0.0, 1.0 + b, (n, 5)) for b, n in enumerate(LENGTHS)]


def dense(blocks: list[np.ndarray]) -> np.ndarray:
    """The same as one problem: own columns of the first segment, of the second, then common."""
    rows = []
    for segment, block in zip(SEGMENTS, blocks, strict=True):
        own = np.zeros((len(block), 2 * OWN))
        own[:, OWN * segment : OWN * segment + OWN] = block[:, :OWN]
        rows.append(np.hstack((own, block[:, OWN:])))
    return np.concatenate(rows)


def clusters(blocks: list[np.ndarray], residuals: np.ndarray) -> Clusters:
    """Return the problem block by block; the residuals are orthogonal to the derivatives."""
    whole = dense(blocks)
    scale = np.linalg.norm(whole, axis=0)
    inverse = np.linalg.inv((whole / scale).T @ (whole / scale)) / np.outer(scale, scale)
    parts = np.split(residuals, np.cumsum(LENGTHS)[:-1])
    return Clusters(
        np.array([block.T @ block for block in blocks]),
        np.array([block.T @ part for block, part in zip(blocks, parts, strict=True)]),
        SEGMENTS,
        inverse[-COMMON:, -COMMON:],
    )


def response(blocks: list[np.ndarray]) -> np.ndarray:
    """Influences as linear functions of the noise, shape (common, blocks, samples)."""
    columns, _ = np.linalg.qr(dense(blocks) / np.linalg.norm(dense(blocks), axis=0))
    left = np.eye(sum(LENGTHS)) - columns @ columns.T
    return np.stack([cluster_influences(clusters(blocks, e))[0] for e in left.T], axis=2)


def test_unbiased_in_white_noise():
    """Assert that the mean of the variances is that of white noise, to rounding."""
    blocks = derivatives()
    mean = np.sum(response(blocks) ** 2, axis=(1, 2))
    assert mean == pytest.approx(np.diag(clusters(blocks, np.zeros(200)).inverse), rel=1e-8)


def test_degrees_of_freedom_are_satterthwaites():
    """Assert that they come from the eigenvalues of the variance as a quadratic form."""
    blocks = derivatives(1)
    _, freedom = cluster_influences(clusters(blocks, np.zeros(200)))
    for c, matrix in enumerate(response(blocks)):
        eigenvalues = np.linalg.eigvalsh(matrix @ matrix.T)
        assert freedom[c] == pytest.approx(eigenvalues.sum() ** 2 / np.sum(eigenvalues**2))


def test_mean_of_equal_blocks():
    """Assert the textbook: the spread of B means over B, with B - 1 degrees of freedom."""
    sums = np.array([3.0, -1.0, 4.0, 1.0, -5.0, 2.0, -4.0])
    count, length = len(sums), 50
    problem = Clusters(
        np.full((count, 1, 1), float(length)),
        sums[:, None],
        np.arange(count),
        np.array([[1.0 / (count * length)]]),
    )
    influences, freedom = cluster_influences(problem)
    assert freedom == pytest.approx([count - 1])
    expected = np.var(sums / length, ddof=1) / count
    assert np.sum(influences**2) == pytest.approx(expected)


def test_units_do_not_matter():
    """Assert that unknowns in other units have influences in these units."""
    residuals = np.random.default_rng(4).standard_normal(200)
    blocks = derivatives()
    units = np.array([1e3, 1e-2, 1.0, 1e-6, 10.0])
    plain, freedom = cluster_influences(clusters(blocks, residuals))
    scaled, same = cluster_influences(clusters([block * units for block in blocks], residuals))
    assert scaled * units[OWN:, None] == pytest.approx(plain, rel=1e-6)
    assert same == pytest.approx(freedom, rel=1e-6)


@pytest.mark.parametrize("seen", [(0.0, 0.0, 5.0, 0.0), (0.0, 0.0, 0.0, 0.0)])
def test_what_one_block_decides_is_not_shown(seen):
    """Assert that an unknown that one block sees, or none, has no variance, and the other has."""
    normal = np.array([np.diag([1.0, own]) for own in seen])
    scores = np.array([[0.5, 0.0], [-1.0, 0.0], [0.2, 0.0], [0.3, 0.0]])
    known = 1.0 / sum(seen) if any(seen) else 0.0
    problem = Clusters(normal, scores, np.arange(4), np.diag([0.25, known]))
    influences, freedom = cluster_influences(problem)
    assert freedom == pytest.approx([3.0, 0.0])
    assert np.all(influences[1] == 0.0)
