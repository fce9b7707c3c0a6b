"""Covariances from blocks: unbiased, with degrees of freedom, and shrunken to white noise's."""

import numpy as np
import pytest
from noisy_joint import joint_samples

import flexid.estimators.cluster_covariance as cluster_covariance
from flexid.estimators.cluster_covariance import (
    _freedom_ratio,
    block_influences,
    block_lengths,
    cluster_influences,
    covariance_root,
    kept_covariance,
    shrunken,
    unbiased,
)
from flexid.estimators.state_variable_filter import LeastSquaresFit, filtered_least_squares
from flexid.models.flexible_joint import flexible_joint

LENGTHS = (40, 25, 60, 30, 45)
SEGMENTS = np.array([0, 0, 1, 1, 1])
OWN, COMMON = 2, 3


def derivatives(seed: int = 0) -> list[np.ndarray]:
    """Return derivatives by block, of different sizes: two own unknowns, three common ones."""
    generator = np.random.default_rng(seed)
    sizes = np.array([1.0, 30.0, 1e-3, 5.0, 1e4])
    return [sizes * generator.normal(0.0, 1.0 + b, (n, 5)) for b, n in enumerate(LENGTHS)]


def dense(blocks: list[np.ndarray]) -> np.ndarray:
    """Return the dense problem: own columns of the first and second segment, then common ones."""
    rows = []
    for segment, block in zip(SEGMENTS, blocks, strict=True):
        own = np.zeros((len(block), 2 * OWN))
        own[:, OWN * segment : OWN * segment + OWN] = block[:, :OWN]
        rows.append(np.hstack((own, block[:, OWN:])))
    return np.concatenate(rows)


def clusters(blocks: list[np.ndarray], residuals: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the problem by blocks, with residuals orthogonal to the derivatives."""
    whole = dense(blocks)
    scale = np.linalg.norm(whole, axis=0)
    inverse = np.linalg.inv((whole / scale).T @ (whole / scale)) / np.outer(scale, scale)
    parts = np.split(residuals, np.cumsum(LENGTHS)[:-1])
    return (
        np.array([block.T @ block for block in blocks]),
        np.array([block.T @ part for block, part in zip(blocks, parts, strict=True)]),
        SEGMENTS,
        inverse[-COMMON:, -COMMON:],
    )


def response(blocks: list[np.ndarray]) -> np.ndarray:
    """Return influences as linear functions of the noise, shape (common, blocks, samples)."""
    columns, _ = np.linalg.qr(dense(blocks) / np.linalg.norm(dense(blocks), axis=0))
    left = np.eye(sum(LENGTHS)) - columns @ columns.T
    return np.stack([cluster_influences(*clusters(blocks, e))[0] for e in left.T], axis=2)


@pytest.mark.parametrize("seed", [0, 1])
def test_unbiased_in_white_noise_with_satterthwaites_degrees_of_freedom(seed: int):
    """Assert the mean variance in white noise, and degrees of freedom from eigenvalues."""
    blocks = derivatives(seed)
    influences, problem = response(blocks), clusters(blocks, np.zeros(200))
    mean = np.sum(influences**2, axis=(1, 2))
    assert mean == pytest.approx(np.diag(problem[-1]), rel=1e-8)
    _, freedom = cluster_influences(*problem)
    for c, matrix in enumerate(influences):
        eigenvalues = np.linalg.eigvalsh(matrix @ matrix.T)
        assert freedom[c] == pytest.approx(eigenvalues.sum() ** 2 / np.sum(eigenvalues**2))


def test_each_block_undoes_its_own_leverage():
    """Assert by hand that a block with a leverage of three quarters counts twice."""
    normal, scores = np.array([[[3.0]], [[1.0]]]), np.array([[0.6], [-0.6]])
    influences, _ = cluster_influences(normal, scores, np.arange(2), np.array([[0.25]]))
    assert influences[0] == pytest.approx([0.25 * 0.6 / 0.25**0.5, -0.25 * 0.6 / 0.75**0.5])


def test_blocks_that_fade_tell_half():
    """Assert that exponentially decaying weights halve the degrees of freedom."""
    weights = np.exp(-np.arange(2000) / 50.0)
    lengths = np.full(2000, 10.0)
    assert _freedom_ratio(weights, lengths) == pytest.approx(0.5, rel=1e-3)
    scores = np.random.default_rng(1).standard_normal((2000, 1, 1))
    equations = np.full((2000, 1, 1, 1), 10.0), scores
    _, kept = kept_covariance(equations, lengths, weights, [slice(0, 1)], np.zeros(1))
    normals, faded = weights[:, None, None] * equations[0][:, 0], weights[:, None] * scores[:, 0]
    alone = cluster_influences(normals, faded, np.arange(2000), 1.0 / normals.sum(axis=0))
    assert kept == pytest.approx(0.5 * alone[1], rel=1e-3)


@pytest.mark.parametrize("seen", [(0.0, 0.0, 5.0, 0.0), (0.0, 0.0, 0.0, 0.0)])
def test_what_one_block_decides_is_not_shown(seen):
    """Assert no variance of an unknown seen in one block or none, and the other's unchanged."""
    normal = np.array([np.diag([1.0, own]) for own in seen])
    scores = np.array([[0.5, 0.0], [-1.0, 0.0], [0.2, 0.0], [0.3, 0.0]])
    known = 1.0 / sum(seen) if any(seen) else 0.0
    problem = normal, scores, np.arange(4), np.diag([0.25, known])
    influences, freedom = cluster_influences(*problem)
    assert freedom == pytest.approx([3.0, 0.0])
    assert np.all(influences[1] == 0.0)


def test_an_invisible_unknown_hides_no_other():
    """Assert the same result if an unknown's unit is 1e-100 of the usual one."""
    residuals = np.random.default_rng(2).standard_normal(sum(LENGTHS))
    usual = cluster_influences(*clusters(derivatives(), residuals))
    small = np.array([1.0, 1.0, 1.0, 1e-100, 1.0])
    normals, scores, segments, inverse = clusters(derivatives(), residuals)
    scaled = normals * small[:, None] * small, scores * small, segments
    units = small[-COMMON:, None]
    influences, freedom = cluster_influences(*scaled, inverse / units / units.T)
    assert influences * units == pytest.approx(usual[0], rel=1e-6)
    assert freedom == pytest.approx(usual[1], rel=1e-6)


def test_segments_may_be_taken_a_few_at_a_time(monkeypatch: pytest.MonkeyPatch):
    """Assert that seven segments of two blocks give the same in parts as together."""
    blocks = np.random.default_rng(9).standard_normal((14, 10, 3))
    normal, scores = blocks.transpose(0, 2, 1) @ blocks, blocks.sum(axis=1)
    problem = normal, scores, np.repeat(np.arange(7), 2), 1e-3 * np.eye(2)
    together = cluster_influences(*problem)
    monkeypatch.setattr(cluster_covariance, "_AT_ONCE", 4)
    for found, expected in zip(cluster_influences(*problem), together, strict=True):
        assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("shown", "factor"), [(0.19, 0.0), (0.21, (4.0 / 0.21) ** 0.5)])
def test_what_the_blocks_hardly_show_is_not_shown(shown: float, factor: float):
    """Assert zero influences if blocks show below a twentieth of a variance, else full ones."""
    influences, squares, across = np.array([[1.0, -2.0]]), np.array([0.5]), np.array([0.1])
    inverse, gram = np.array([[4.0]]), np.array([[[0.05]]])
    found, freedom = unbiased(influences, inverse, np.array([shown]), squares, across, gram)
    assert found == pytest.approx(factor * np.array([[1.0, -2.0]]))
    assert freedom == pytest.approx([shown**2 / (0.5 + 0.2**2 - 2.0 * 0.1) if factor else 0.0])


def test_a_root_leaves_out_what_is_zero_but_for_rounding():
    """Assert that a covariance of rank one has a root of rank one, with its pseudo-inverse."""
    covariance = np.array([[1.0, 1.0 - 1e-14], [1.0 - 1e-14, 1.0]])
    root, undone = covariance_root(covariance)
    assert root @ root.T == pytest.approx(covariance)
    assert undone.T @ root == pytest.approx(np.diag([0.0, 1.0]), abs=1e-12)


@pytest.fixture(scope="module")
def fits() -> list[LeastSquaresFit]:
    """Return fits to the noisy joint."""
    joint = flexible_joint()
    return [filtered_least_squares([joint_samples(seed)], joint) for seed in range(50)]


def test_rows_share_the_noise_of_the_positions(fits: list[LeastSquaresFit]):
    """Assert the correlation between rows, which share the noise of positions.

    Over 50 seeds theta1 and beta1 correlate by about -0.8. As independent values they would give an
    interval of the gravity torque that is 1.7 times too wide.
    """
    pair = [fits[0].names.index(name) for name in ("theta1", "beta1")]
    spread = np.asarray(np.corrcoef(np.array([fit.values[pair] for fit in fits]).T))[0, 1]
    mean = np.mean([fit.covariance for fit in fits], axis=0)
    first, second = pair
    foretold = mean[first, second] / np.sqrt(mean[first, first] * mean[second, second])
    assert spread < -0.6
    assert foretold == pytest.approx(spread, abs=0.2)


@pytest.mark.parametrize(
    ("lengths", "rate", "count"),
    [([30_000], 20.0, 30), ([10_000], 20.0, 20), ([30_000], 5.0, 15), ([1500, 7, 4000], 20.0, 12)],
    ids=["a second", "shorter for short records", "ten time constants", "of each recording"],
)
def test_blocks_cover_the_recordings(lengths, rate, count):
    """Assert the lengths of blocks, and that no block crosses from one recording to the next."""
    blocks = block_lengths(lengths, [1e-3] * len(lengths), rate, 3)
    assert len(blocks) == count
    assert {*np.cumsum(lengths).tolist()} <= {*np.cumsum(blocks).tolist()}


def test_what_says_nothing():
    """Assert that one block has no degrees of freedom, and a row without unknowns no influences."""
    regressor = np.random.default_rng(2).standard_normal((2, 10))
    inverse = np.linalg.inv(regressor @ regressor.T).astype(np.float64)
    influences, freedom = block_influences(regressor, np.zeros(10), inverse, [10])
    assert not influences.any()
    assert not freedom.any()
    influences, freedom = block_influences(np.zeros((0, 9)), np.ones(9), np.zeros((0, 0)), [4, 5])
    assert (influences.shape, freedom.shape) == ((0, 2), (0,))
    none = np.ones((1, 2, 2)), np.ones((1, 2)), np.zeros(1, int), np.zeros((0, 0))
    assert [found.shape for found in cluster_influences(*none)] == [(0, 1), (0,)]


def test_a_row_that_lacks_blocks_leaves_the_next_as_it_is():
    """Assert that two blocks cannot judge two coefficients, but judge one as if it were alone."""
    generator = np.random.default_rng(4)
    regressors, noise = generator.normal(size=(2, 2, 2, 50)), generator.normal(size=(2, 2, 50))
    matrices = regressors @ regressors.swapaxes(2, 3)
    vectors = np.einsum("brkn,brn->brk", regressors, noise)
    value = vectors[:, 1, 0].sum() / matrices[:, 1, 0, 0].sum()
    covariance, freedom = kept_covariance(
        (matrices, vectors),
        np.full(2, 50.0),
        np.ones(2),
        [slice(0, 2), slice(2, 3)],
        np.array([0.0, 0.0, value]),
    )
    assert np.isinf(np.diag(covariance)[:2]).all()
    assert freedom[:2].tolist() == [0.0, 0.0]
    parts = [regressors[b, 1, :1] for b in range(2)]
    residual = np.concatenate([noise[b, 1] - value * parts[b][0] for b in range(2)])
    inverse = np.array([[1.0 / matrices[:, 1, 0, 0].sum()]])
    influences, alone = block_influences(np.hstack(parts), residual, inverse, [50, 50])
    assert covariance[2, 2] == pytest.approx((influences @ influences.T).item())
    assert covariance[2, 2] > 0.0
    assert freedom[2] == pytest.approx(alone.item())


def test_published_formula():
    """Assert values by hand for traces 4 and 10 of two directions, and an infinite variance."""
    spread, white = np.diag([3.0, np.inf, 1.0]), np.diag([1.0, 5.0, 1.0])
    covariance, freedom = shrunken(spread, white, np.array([10.0, 0.0, 10.0]))
    assert np.isinf(covariance[1, 1])
    # (0 * 10 + 16) / ((10 + 1 - 1) * (10 - 16 / 2)) = 0.8 towards 2 I
    assert covariance[np.ix_([0, 2], [0, 2])] == pytest.approx(np.diag([2.2, 1.8]))
    known = 1.0 / (0.2**2 / 10.0 + 0.8**2 / 20.0)
    assert freedom == pytest.approx([known, 0.0, known])


def test_nothing_is_surer_than_the_sensors():
    """Assert that blocks with less scatter than white noise get the covariance of white noise."""
    mixed = np.random.default_rng(8).standard_normal((6, 6))
    white = mixed @ mixed.T
    covariance, _ = shrunken(0.1 * white, white, np.full(6, 12.0))
    assert covariance == pytest.approx(white)
    one, freedom = shrunken(np.array([[0.1]]), np.array([[2.0]]), np.array([7.0]))
    assert one == pytest.approx(2.0)
    assert freedom == pytest.approx(7.0)
