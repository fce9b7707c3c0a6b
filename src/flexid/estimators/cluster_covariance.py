"""Covariance of least squares with correlated residuals, unbiased although blocks are few."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.normal_equations import eigen, scaled_inverse, scaled_pseudo_inverse

_WHOLE = 1e-6  # what a block leaves of a direction's residual, below which it leaves nothing
_ROUNDING = 1e-13  # relative size below which an eigenvalue of a covariance is zero
_AT_ONCE = 1024  # blocks whose matrices are kept in memory together
_LEAST_SHARE = 0.05  # of a variance that the blocks must be able to show


@dataclass(frozen=True, eq=False)
class Clusters:
    """A least-squares problem at its solution, block by block."""

    # (n_blocks, n, n): normal matrix of each block: its segment's own unknowns first, then the k
    # common ones
    normal: FloatArray
    scores: FloatArray  # (n_blocks, n): derivatives times residuals, summed over each block
    # (n_blocks,): the segment of each block, counted from 0; blocks of a segment lie side by side
    segments: NDArray[np.int64]
    # (k, k): inverse of the normal matrix of the common unknowns, the others eliminated; zero along
    # directions that the data leave open
    inverse: FloatArray


# The scores are summed over blocks long enough to be independent; the spread of the sums gives the
# covariance (cluster sandwich). The fit has pulled the residuals towards zero, and few blocks may
# carry the spread. Bell and McCaffrey (Survey Methodology 28, 2002) and Pustejovsky and Tipton
# (J. Business and Economic Statistics 36, 2018) correct both exactly for white noise. With J_b the
# derivatives in a block, N_b = J_bᵀJ_b, G the covariance for white noise of unit variance,
#     u_b = G J_bᵀ (I - J_b G J_bᵀ)^(-1/2) r_b,        V = Σ u_b u_bᵀ,
# and (Σ λ)² / Σ λ² degrees of freedom, λ the eigenvalues of each variance as a quadratic form in
# white noise (Satterthwaite). N_b and the scores J_bᵀ r_b are enough, since
# J_bᵀ (I - J_b G J_bᵀ)^(-1/2) = (I - N_b G)^(-1/2) J_bᵀ. A segment's initial state is fitted, too.
def cluster_influences(clusters: Clusters) -> tuple[FloatArray, FloatArray]:
    """Influences U, (k, n_blocks), on common unknowns (covariance U Uᵀ), and degrees of freedom."""
    k = len(clusters.inverse)
    influences = np.zeros((k, len(clusters.normal)))
    if k == 0:
        return influences, np.zeros(0)
    shown = np.zeros(k)  # trace of the quadratic form, for white noise of unit variance
    squares, across, gram = np.zeros(k), np.zeros(k), np.zeros((k, k, k))
    inverse = clusters.inverse
    for places in _alike(clusters.segments):
        normal, scores = clusters.normal[places], clusters.scores[places]
        own, borders = _own_unknowns(normal.sum(axis=1), k)
        adjusted = _adjusted(normal, own, borders, inverse)
        influences[:, places] = np.einsum("sbcn,sbn->csb", adjusted, scores)
        # One row for each block: how white noise enters each unknown's influence, through J_b.
        rows = adjusted @ normal
        alone = np.einsum("sbcn,sbcn->scb", rows, adjusted)
        rows = rows.transpose(0, 2, 1, 3)  # segment, unknown, block, n
        part = -rows @ own[:, None] @ rows.transpose(0, 1, 3, 2)
        part[:, :, *np.diag_indices(part.shape[2])] += alone
        common = rows @ borders[:, None]
        shared = common @ inverse @ common.transpose(0, 1, 3, 2)
        shown += np.einsum("scbb->c", part) - np.einsum("scbb->c", shared)
        squares += np.einsum("scbd,scbd->c", part, part)
        across += np.einsum("scbd,scdb->c", shared, part)
        gram += np.einsum("scbi,scbj->cij", common, common)
    return unbiased(influences, inverse, shown, squares, across, gram)


def unbiased(
    influences: FloatArray,  # (k, n_blocks)
    inverse: FloatArray,  # (k, k)
    shown: FloatArray,  # (k,)
    squares: FloatArray,  # (k,)
    across: FloatArray,  # (k,)
    gram: FloatArray,  # (k, k, k)
) -> tuple[FloatArray, FloatArray]:
    """Scale influences to the variance that white noise has, and count degrees of freedom."""
    products = inverse @ gram
    squares = squares + np.einsum("cij,cji->c", products, products) - 2.0 * across
    variances = np.diag(inverse)
    visible = (shown > _LEAST_SHARE * variances) & (variances > 0.0)
    safe = np.where(visible, shown, 1.0)
    # 1 unless a block alone decides a direction: its residuals show nothing of that.
    influences *= np.where(visible, np.sqrt(variances / safe), 0.0)[:, None]
    freedom = np.where(visible, shown**2 / np.where(visible, squares, 1.0), 0.0)
    return influences, freedom


def covariance_root(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Matrices H and O with H Hᵀ the covariance, (..., n, n), and Oᵀ H = I on its range."""
    scale = np.sqrt(np.einsum("...ii->...i", covariance))
    scale = np.where(scale > 0.0, scale, 1.0)
    scales = scale[..., :, None] * scale[..., None, :]
    eigenvalues, vectors = eigen(covariance / scales)
    kept = eigenvalues > _ROUNDING * eigenvalues[..., -1:]
    root = np.sqrt(np.where(kept, eigenvalues, 1.0))[..., None, :]
    vectors = np.where(kept[..., None, :], vectors, 0.0)
    return vectors * root * scale[..., :, None], vectors / root / scale[..., :, None]


def _unbiasing(leverages: FloatArray) -> FloatArray:
    """Factor by which a fit has shrunk residuals along directions of these leverages, undone."""
    left = 1.0 - leverages
    return np.where(left > _WHOLE, 1.0 / np.sqrt(np.maximum(left, _WHOLE)), 0.0)


def _adjusted(
    normal: FloatArray, own: FloatArray, borders: FloatArray, inverse: FloatArray
) -> FloatArray:
    """Matrices, (n_segments, n_blocks, k, n), by which scores become influences."""
    across = borders.transpose(0, 2, 1)
    half, other = covariance_root(own + borders @ inverse @ across)
    half, other, turned = half[:, None], other[:, None], half.transpose(0, 2, 1)[:, None]
    leverages, directions = eigen(turned @ normal @ half)
    back = directions.transpose(0, 1, 3, 2) @ turned
    correction = other @ (directions * _unbiasing(leverages)[:, :, None, :]) @ back
    return (inverse @ across)[:, None] @ correction


def _own_unknowns(
    total: FloatArray,  # (n_segments, n, n)
    k: int,
) -> tuple[FloatArray, FloatArray]:
    """Segments' own covariance, (n_segments, n, n), and how common unknowns enter, (..., n, k)."""
    count, n, _ = total.shape
    first = n - k
    own = np.zeros((count, n, n))
    borders = np.zeros((count, n, k))
    borders[:, first:] = np.eye(k)
    if first:
        own[:, :first, :first] = scaled_pseudo_inverse(total[:, :first, :first], _ROUNDING)
        borders[:, :first] = -own[:, :first, :first] @ total[:, :first, first:]
    return own, borders


def _alike(segments: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Places of the blocks of segments with equally many, shape (n_segments, n_blocks) each."""
    firsts = np.flatnonzero(np.diff(segments, prepend=-1))
    counts = np.diff(firsts, append=len(segments))
    for count in np.unique(counts).tolist():
        chosen = firsts[counts == count]
        at_once = max(1, _AT_ONCE // count)
        for first in range(0, len(chosen), at_once):
            yield chosen[first : first + at_once, None] + np.arange(count)


# Few blocks give few degrees of freedom, and short intervals where they agree by chance. Where G is
# the identity, the blocks' covariance S is drawn towards φ I, by how much the traces of S and S²
# say: oracle approximating shrinkage (Chen, Wiesel, Eldar and Hero, IEEE Trans. Signal Processing
# 58, 2010, eq. 23).
def shrunken(
    spread: FloatArray,  # (k, k)
    white: FloatArray,  # (k, k)
    freedom: FloatArray,  # (k,)
) -> tuple[FloatArray, FloatArray]:
    """The covariance drawn towards that of white noise, and its degrees of freedom, shape (k,)."""
    known = (freedom > 0.0) & (np.diag(white) > 0.0)
    _, back = covariance_root(white[np.ix_(known, known)])
    p = int(np.count_nonzero(np.any(back != 0.0, axis=0)))
    if p == 0:
        return spread, freedom
    part, own = np.ix_(known, known), freedom[known]
    mean_freedom = len(own) / float(np.sum(1.0 / own))
    alone = back.T @ spread[part] @ back
    factor = max(float(np.trace(alone)) / p, 1.0)
    share = _share(alone, p, mean_freedom)
    covariance, degrees = spread.copy(), freedom.copy()
    covariance[part] = (1.0 - share) * spread[part] + share * factor * white[part]
    degrees[known] = 1.0 / ((1.0 - share) ** 2 / own + share**2 / (p * mean_freedom))
    return covariance, degrees


def _share(alone: FloatArray, p: int, freedom: float) -> float:
    """What the multiple of the identity counts beside a covariance in p directions."""
    if p == 1:
        return 1.0
    trace, squares = float(np.trace(alone)), float(np.sum(alone**2))
    apart = (freedom + 1.0 - 2.0 / p) * (squares - trace**2 / p)
    alike = (1.0 - 2.0 / p) * squares + trace**2
    return 1.0 if alike >= apart else alike / apart


BLOCK_DURATION = 1.0  # length of a block in s, if the record has room for `WANTED_BLOCKS` of them

WANTED_BLOCKS = 20

_INDEPENDENCE = 10.0  # time constants of the filter that a block spans at least


def block_duration(total: float) -> float:
    """Wanted length of a block in s for a record of a total length in s."""
    return min(BLOCK_DURATION, total / WANTED_BLOCKS)


def block_lengths(
    lengths: Sequence[int],
    sample_times: Sequence[float],  # in s
    filter_rate: float,  # in 1/s
    n_coefficients: int,
) -> list[int]:
    """Equations in each block of contiguous recordings; none crosses from one to the next."""
    total = sum(n * h for n, h in zip(lengths, sample_times, strict=True))
    blocks = []
    for n, sample_time in zip(lengths, sample_times, strict=True):
        blocks += _divided(n, _block_size(total, sample_time, filter_rate, n_coefficients))
    return blocks


def _block_size(total: float, sample_time: float, filter_rate: float, n_coefficients: int) -> int:
    """Equations in a block of a record of a total length in s; the rest as for `block_lengths`."""
    duration = max(block_duration(total), _INDEPENDENCE / filter_rate)
    # A short record gets shorter blocks than wanted rather than no interval at all.
    duration = min(duration, total / (n_coefficients + 3))
    return max(1, round(duration / sample_time))


def _divided(n: int, size: int) -> list[int]:
    """Blocks of a size; what is left over is one more, or belongs to the last if less than half."""
    count = max(1, (2 * n + size) // (2 * size))
    return [size] * (count - 1) + [n - (count - 1) * size]


def block_influences(
    regressor: FloatArray,  # (k, n)
    residual: FloatArray,  # (n,)
    inverse: FloatArray,  # (k, k)
    blocks: Sequence[int],
) -> tuple[FloatArray, FloatArray]:
    """How far each block's residuals move the coefficients, and degrees of freedom of each."""
    edges = np.concatenate(([0], np.cumsum(blocks, dtype=np.int64)))
    parts = [slice(first, stop) for first, stop in pairwise(edges)]
    k, count = len(inverse), len(parts)
    if k == 0 or count == 0:
        return np.zeros((k, count)), np.zeros(k)
    normal = np.array([regressor[:, part] @ regressor[:, part].T for part in parts])
    scores = np.array([regressor[:, part] @ residual[part] for part in parts])
    return cluster_influences(Clusters(normal, scores, np.arange(count), inverse))


def covariance_of(influences: FloatArray, unknown: NDArray[np.bool_]) -> FloatArray:
    """Covariance, shape (n, n), with infinite variance of what is unknown, shape (n,)."""
    covariance = influences @ influences.T
    covariance[unknown, :] = covariance[:, unknown] = 0.0
    covariance[unknown, unknown] = np.inf
    return covariance


def kept_covariance(
    equations: tuple[FloatArray, FloatArray],  # σ r rᵀ (n_blocks, n_rows, k, k), σ r y (..., k)
    lengths: FloatArray,  # (n_blocks,): samples in each block
    weights: FloatArray,  # (n_blocks,): weight of each block, 1 if nothing is forgotten
    rows: Sequence[slice],  # of the values; a row may have fewer than k
    values: FloatArray,  # (n_coefficients,)
) -> tuple[FloatArray, FloatArray]:
    """Covariance from normal equations of blocks, and degrees of freedom, 0 where unknown."""
    count = len(weights)
    influences = np.zeros((len(values), count))
    freedom = np.zeros(len(values))
    for place, part in enumerate(rows):
        k = part.stop - part.start
        if count <= k:
            continue
        matrices, vectors = equations[0][:, place, :k, :k], equations[1][:, place, :k]
        normal = weights[:, None, None] * matrices
        scores = weights[:, None] * (vectors - matrices @ values[part])
        total = normal.sum(axis=0)
        inverse, free = scaled_inverse(total, np.sqrt(np.diag(total)))
        try:
            clusters = Clusters(normal, scores, np.arange(count), inverse)
            influences[part], degrees = cluster_influences(clusters)
        except np.linalg.LinAlgError:  # of numbers that no drive has
            continue
        freedom[part] = np.where(free, 0.0, degrees * _fading(weights, lengths))
    return covariance_of(influences, freedom == 0.0), freedom


def _fading(w: FloatArray, n: FloatArray) -> float:
    """Degrees of freedom in fading weights over those in weights of blocks that count alike."""
    alike = np.sum(w * n) ** 2 / np.sum(w**2 * n**2)
    return float(np.sum(w**2 * n) ** 2 / np.sum(w**4 * n**2) / alike)
