"""Covariance from few blocks, against closed forms and brute force."""

from dataclasses import replace

import numpy as np
import pytest

import flexid.estimators.cluster_covariance as cluster_covariance
from flexid.estimators.cluster_covariance import (
    Clusters,
    cluster_influences,
    covariance_root,
    unbiased,
)

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
    units = np.array([1e8, 1e-2, 1.0, 1e-6, 10.0])
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


def test_own_unknowns_on_which_nothing_depends_change_nothing():
    """Assert that influences are those without an initial state that no sample shows."""
    problem = clusters(derivatives(), np.random.default_rng(4).standard_normal(200))
    normal = np.pad(problem.normal, ((0, 0), (1, 0), (1, 0)))
    padded = replace(problem, normal=normal, scores=np.pad(problem.scores, ((0, 0), (1, 0))))
    for found, expected in zip(
        cluster_influences(padded), cluster_influences(problem), strict=True
    ):
        assert found == pytest.approx(expected, rel=1e-9)


def test_segments_may_be_taken_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch):
    """Assert that seven segments of two blocks are as they are together."""
    blocks = np.random.default_rng(9).standard_normal((14, 10, 3))
    normal, scores = blocks.transpose(0, 2, 1) @ blocks, blocks.sum(axis=1)
    problem = Clusters(normal, scores, np.repeat(np.arange(7), 2), 1e-3 * np.eye(2))
    together = cluster_influences(problem)
    monkeypatch.setattr(cluster_covariance, "_AT_ONCE", 4)
    for found, expected in zip(cluster_influences(problem), together, strict=True):
        assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("shown", "factor"), [(0.19, 0.0), (0.21, (4.0 / 0.21) ** 0.5)])
def test_what_the_blocks_hardly_show_is_not_shown(shown: float, factor: float):
    """Assert that below a twentieth of a variance nothing is said, and beyond it all of it."""
    influences, squares, across = np.array([[1.0, -2.0]]), np.array([0.5]), np.array([0.1])
    inverse, gram = np.array([[4.0]]), np.array([[[0.05]]])
    found, freedom = unbiased(influences, inverse, np.array([shown]), squares, across, gram)
    assert found == pytest.approx(factor * np.array([[1.0, -2.0]]))
    assert freedom == pytest.approx([shown**2 / (0.5 + 0.2**2 - 2.0 * 0.1) if factor else 0.0])


def test_a_root_leaves_out_what_is_zero_but_for_rounding():
    """Assert that a covariance of rank one has a root of rank one, and what undoes it."""
    covariance = np.array([[1.0, 1.0 - 1e-14], [1.0 - 1e-14, 1.0]])
    root, undone = covariance_root(covariance)
    assert root @ root.T == pytest.approx(covariance)
    assert undone.T @ root == pytest.approx(np.diag([0.0, 1.0]), abs=1e-12)
