"""Covariance of least squares with correlated residuals, corrected for few blocks."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.normal_equations import eigen, scaled_inverse, scaled_pseudo_inverse

_LEAST_LEFT = 1e-6  # 1 - leverage below which a block alone determines a direction
_ROUNDING = 1e-13  # relative size below which an eigenvalue of a covariance is zero
_AT_ONCE = 1024  # largest number of blocks whose matrices are in memory together
_LEAST_SHARE = 0.05  # smallest part of a variance that the blocks' scores must show


# The scores are summed over blocks long enough to be independent; the spread of the sums gives the
# covariance (cluster sandwich). The fit makes residuals too small, and few blocks may make up most
# of the spread. Bell and McCaffrey (Survey Methodology 28, 2002) and Pustejovsky and Tipton
# (J. Business and Economic Statistics 36, 2018) correct both exactly for white noise. With J_b the
# derivatives in a block, N_b = J_bᵀJ_b, G the covariance for white noise of unit variance,
#     u_b = G J_bᵀ (I - J_b G J_bᵀ)^(-1/2) r_b,        V = Σ u_b u_bᵀ,
# and (Σ λ)² / Σ λ² degrees of freedom, λ the eigenvalues of each variance as a quadratic form in
# white noise (Satterthwaite). N_b and the scores J_bᵀ r_b are enough, since
# J_bᵀ (I - J_b G J_bᵀ)^(-1/2) = (I - N_b G)^(-1/2) J_bᵀ. Initial states count as fitted, too.
def cluster_influences(
    # (n_blocks, n, n): normal matrix of each block at the solution of a least-squares problem:
    # first the unknowns of its segment, then the k common unknowns
    normals: FloatArray,
    scores: FloatArray,  # (n_blocks, n): derivatives times residuals, summed over each block
    segments: NDArray[np.int64],  # (n_blocks,): of each block, from 0 on; adjacent if the same
    # (k, k): inverse of the common unknowns' normal matrix after elimination of the segments' own
    # unknowns; zero in undetermined directions
    inverse: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return influences U, (k, n_blocks), with covariance U Uᵀ, and degrees of freedom, (k,)."""
    k = len(inverse)
    influences = np.zeros((k, len(normals)))
    if k == 0:
        return influences, np.zeros(0)
    normals, scores, inverse, units = _in_units(normals, scores, inverse)
    shown = np.zeros(k)  # trace of the quadratic form, for white noise of unit variance
    squares, across, gram = np.zeros(k), np.zeros(k), np.zeros((k, k, k))
    for places in _by_block_count(segments):
        normal = normals[places]
        own, borders = _own_unknowns(normal.sum(axis=1), k)
        adjusted = _adjusted(normal, own, borders, inverse)
        influences[:, places] = np.einsum("sbcn,sbn->csb", adjusted, scores[places])
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
    influences, freedom = unbiased(influences, inverse, shown, squares, across, gram)
    return influences * units[:, None], freedom


def _in_units(
    normals: FloatArray, scores: FloatArray, inverse: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the arrays with common unknowns in units near their deviations, and the units, (k,).

    Fourth powers of the deviation of an invisible unknown would overflow. Powers of two leave all
    digits as they are.
    """
    variances = np.diag(inverse)
    units = np.exp2(np.round(0.5 * np.log2(np.where(variances > 0.0, variances, 1.0))))
    every = np.concatenate([np.ones(normals.shape[-1] - len(units)), units])
    normals = normals * every[:, None] * every
    return normals, scores * every, inverse / units[:, None] / units, units


def unbiased(
    influences: FloatArray,  # (k, n_blocks)
    inverse: FloatArray,  # (k, k)
    shown: FloatArray,  # (k,)
    squares: FloatArray,  # (k,)
    across: FloatArray,  # (k,)
    gram: FloatArray,  # (k, k, k)
) -> tuple[FloatArray, FloatArray]:
    """Scale influences to be unbiased in white noise; return degrees of freedom too."""
    products = inverse @ gram
    squares = squares + np.einsum("cij,cji->c", products, products) - 2.0 * across
    variances = np.diag(inverse)
    visible = (shown > _LEAST_SHARE * variances) & (variances > 0.0)
    safe = np.where(visible, shown, 1.0)
    # The factor is 1 unless a block alone determines a direction, which its residuals do not show.
    influences *= np.where(visible, np.sqrt(variances / safe), 0.0)[:, None]
    freedom = np.where(visible, shown**2 / np.where(visible, squares, 1.0), 0.0)
    return influences, freedom


def covariance_root(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return H with H Hᵀ = covariance, (..., n, n), and O with Oᵀ H = I on the range."""
    scale = np.sqrt(np.einsum("...ii->...i", covariance))
    scale = np.where(scale > 0.0, scale, 1.0)
    scales = scale[..., :, None] * scale[..., None, :]
    eigenvalues, vectors = eigen(covariance / scales)
    kept = eigenvalues > _ROUNDING * eigenvalues[..., -1:]
    root = np.sqrt(np.where(kept, eigenvalues, 1.0))[..., None, :]
    vectors = np.where(kept[..., None, :], vectors, 0.0)
    return vectors * root * scale[..., :, None], vectors / root / scale[..., :, None]


def _adjusted(
    normal: FloatArray, own: FloatArray, borders: FloatArray, inverse: FloatArray
) -> FloatArray:
    """Matrices, (n_segments, n_blocks, k, n), that turn scores into influences."""
    across = borders.transpose(0, 2, 1)
    half, other = covariance_root(own + borders @ inverse @ across)
    half, other, turned = half[:, None], other[:, None], half.transpose(0, 2, 1)[:, None]
    leverages, directions = eigen(turned @ normal @ half)
    back = directions.transpose(0, 1, 3, 2) @ turned
    # (1 - leverage)^(-1/2) undoes the shrinking of residuals by the fit.
    left = 1.0 - leverages[:, :, None, :]
    growth = np.where(left > _LEAST_LEFT, 1.0 / np.sqrt(np.maximum(left, _LEAST_LEFT)), 0.0)
    correction = other @ (directions * growth) @ back
    return (inverse @ across)[:, None] @ correction


def _own_unknowns(
    total: FloatArray,  # (n_segments, n, n)
    k: int,
) -> tuple[FloatArray, FloatArray]:
    """Own covariance of segments, (n_segments, n, n), and gain of common unknowns, (..., n, k)."""
    count, n, _ = total.shape
    first = n - k
    own = np.zeros((count, n, n))
    borders = np.zeros((count, n, k))
    borders[:, first:] = np.eye(k)
    if first:
        own[:, :first, :first] = scaled_pseudo_inverse(total[:, :first, :first], _ROUNDING)
        borders[:, :first] = -own[:, :first, :first] @ total[:, :first, first:]
    return own, borders


def _by_block_count(segments: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Yield block indices, (n_segments, n_blocks), of segments with equally many blocks."""
    firsts = np.flatnonzero(np.diff(segments, prepend=-1))
    counts = np.diff(firsts, append=len(segments))
    for count in np.unique(counts).tolist():
        chosen = firsts[counts == count]
        at_once = max(1, _AT_ONCE // count)
        for first in range(0, len(chosen), at_once):
            yield chosen[first : first + at_once, None] + np.arange(count)


# Few blocks give few degrees of freedom, and too short intervals if the blocks agree by chance. In
# coordinates with G = I, the blocks' covariance S is shrunk towards φ I; the traces of S and S² set
# the weight: oracle approximating shrinkage (Chen, Wiesel, Eldar and Hero, IEEE Trans. Signal
# Processing 58, 2010, eq. 23).
def shrunken(
    spread: FloatArray,  # (k, k)
    white: FloatArray,  # (k, k)
    freedom: FloatArray,  # (k,)
) -> tuple[FloatArray, FloatArray]:
    """Shrink a covariance towards the one for white noise; return degrees of freedom, (k,), too."""
    known = (freedom > 0.0) & (np.diag(white) > 0.0)
    _, back = covariance_root(white[np.ix_(known, known)])
    p = int(np.count_nonzero(np.any(back != 0.0, axis=0)))
    if p == 0:
        return spread, freedom
    part, own = np.ix_(known, known), freedom[known]
    mean_freedom = len(own) / float(np.sum(1.0 / own))
    alone = back.T @ spread[part] @ back
    factor = max(float(np.trace(alone)) / p, 1.0)
    share = _shrinkage(alone, p, mean_freedom)
    covariance, degrees = spread.copy(), freedom.copy()
    covariance[part] = (1.0 - share) * spread[part] + share * factor * white[part]
    degrees[known] = 1.0 / ((1.0 - share) ** 2 / own + share**2 / (p * mean_freedom))
    return covariance, degrees


def _shrinkage(alone: FloatArray, p: int, freedom: float) -> float:
    """Weight, from 0 to 1, of the multiple of the identity, for a covariance in p directions."""
    if p == 1:
        return 1.0
    trace, squares = float(np.trace(alone)), float(np.sum(alone**2))
    apart = (freedom + 1.0 - 2.0 / p) * (squares - trace**2 / p)
    alike = (1.0 - 2.0 / p) * squares + trace**2
    return 1.0 if alike >= apart else alike / apart


BLOCK_DURATION = 1.0  # length of a block in s, if the log has room for `WANTED_BLOCKS` of them

WANTED_BLOCKS = 20

_INDEPENDENCE = 10.0  # smallest length of a block in time constants of the filter


def block_duration(total: float) -> float:
    """Return the wanted length of a block in s for a log of a total length in s."""
    return min(BLOCK_DURATION, total / WANTED_BLOCKS)


def block_lengths(
    lengths: Sequence[int],
    sample_times: Sequence[float],  # in s
    filter_rate: float,  # in 1/s
    n_coefficients: int,
) -> list[int]:
    """Return the number of equations in each block; a block lies within one recording."""
    total = sum(n * h for n, h in zip(lengths, sample_times, strict=True))
    duration = max(block_duration(total), _INDEPENDENCE / filter_rate)
    # A short log gets shorter blocks than wanted, so that it still has intervals.
    duration = min(duration, total / (n_coefficients + 3))
    blocks = []
    for n, sample_time in zip(lengths, sample_times, strict=True):
        size = max(1, round(duration / sample_time))
        count = max(1, (2 * n + size) // (2 * size))  # a shorter remainder joins the last block
        blocks += [size] * (count - 1) + [n - (count - 1) * size]
    return blocks


def block_influences(
    regressor: FloatArray,  # (k, n)
    residual: FloatArray,  # (n,)
    inverse: FloatArray,  # (k, k)
    blocks: Sequence[int],
) -> tuple[FloatArray, FloatArray]:
    """Return each block's influence on the coefficients, (k, n_blocks), and degrees of freedom."""
    edges = np.concatenate(([0], np.cumsum(blocks, dtype=np.int64)))
    parts = [slice(first, stop) for first, stop in pairwise(edges)]
    count = len(parts)
    if count == 0:
        return np.zeros((len(inverse), 0)), np.zeros(len(inverse))
    normal = np.array([regressor[:, part] @ regressor[:, part].T for part in parts])
    scores = np.array([regressor[:, part] @ residual[part] for part in parts])
    return cluster_influences(normal, scores, np.arange(count), inverse)


def covariance_of(influences: FloatArray, unknown: NDArray[np.bool_]) -> FloatArray:
    """Return the covariance, shape (n, n), with infinite variance under a mask, shape (n,)."""
    covariance = influences @ influences.T
    covariance[unknown, :] = covariance[:, unknown] = 0.0
    covariance[unknown, unknown] = np.inf
    return covariance


def kept_covariance(
    equations: tuple[FloatArray, FloatArray],  # Σ r rᵀ (n_blocks, n_rows, k, k), Σ r y (..., k)
    lengths: FloatArray,  # (n_blocks,): samples in each block
    weights: FloatArray,  # (n_blocks,): weight of each block, 1 if nothing is forgotten
    rows: Sequence[slice],  # each row's part of the values, at most k long
    values: FloatArray,  # (n_coefficients,)
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance from blocks' normal equations, and degrees of freedom, 0 if unknown."""
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
            found = cluster_influences(normal, scores, np.arange(count), inverse)
        except np.linalg.LinAlgError:  # numbers far outside the range of any drive
            continue
        influences[part] = found[0]
        freedom[part] = np.where(free, 0.0, found[1] * _freedom_ratio(weights, lengths))
    return covariance_of(influences, freedom == 0.0), freedom


def _freedom_ratio(w: FloatArray, n: FloatArray) -> float:
    """Ratio of degrees of freedom with fading weights w to degrees with equal weights."""
    alike = np.sum(w * n) ** 2 / np.sum(w**2 * n**2)
    return float(np.sum(w**2 * n) ** 2 / np.sum(w**4 * n**2) / alike)
