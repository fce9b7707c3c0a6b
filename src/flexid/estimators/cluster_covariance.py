"""Covariance of least squares with correlated residuals, unbiased although blocks are few.

The scores, derivatives times residuals, are summed over blocks long enough to be independent of one
another, and the spread of these sums gives the covariance (cluster sandwich). Two things are amiss
with it as it stands: the fit has pulled the residuals towards zero, most where a block decides most
(its leverage), and a few blocks may carry nearly all of the spread, which then has fewer degrees of
freedom than there are blocks. Both have an answer that is exact for white noise and good for others
(Bell and McCaffrey, Survey Methodology 28, 2002; Pustejovsky and Tipton, J. Business and Economic
Statistics 36, 2018). With J_b the derivatives in a block, N_b = J_bᵀJ_b, and G the covariance for
white noise of unit variance,

    u_b = G J_bᵀ (I - J_b G J_bᵀ)^(-1/2) r_b,        V = Σ u_b u_bᵀ,

and (Σ λ)² / Σ λ² degrees of freedom for each coefficient, λ being the eigenvalues of its variance
as a quadratic form in white noise (Satterthwaite). Only N_b and the scores J_bᵀ r_b are needed,
since J_bᵀ (I - J_b G J_bᵀ)^(-1/2) = (I - N_b G)^(-1/2) J_bᵀ.

Some of the unknowns may belong to a segment of the record only: an initial state. They are fitted
like the rest, and a block's residuals are corrected for them too.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flexid.estimators.samples import FloatArray

_WHOLE = 1e-6  # what a block leaves of a direction's residual, below which it leaves nothing
_ROUNDING = 1e-13  # relative size below which an eigenvalue of a covariance is zero
_LEAST_SHARE = 0.05  # of a variance that the blocks must be able to show


@dataclass(frozen=True, eq=False)
class Clusters:
    """A least-squares problem at its solution, block by block.

    Parameters
    ----------
    normal : array, shape (n_blocks, n, n)
        Normal matrix of each block: its segment's own unknowns first, then the k common ones.
    scores : array, shape (n_blocks, n)
        Derivatives times residuals, summed over each block.
    segments : array of int, shape (n_blocks,)
        The segment of each block, counted from 0; blocks of a segment lie side by side.
    inverse : array, shape (k, k)
        Inverse of the normal matrix of the common unknowns, the others eliminated; zero along
        directions that the data leave open.
    """

    normal: FloatArray
    scores: FloatArray
    segments: NDArray[np.int64]
    inverse: FloatArray


def cluster_influences(clusters: Clusters) -> tuple[FloatArray, FloatArray]:
    """How far each block's residuals move the common unknowns, freed of the fit's bias.

    With U the influences, those of other problems over the same blocks among them, U Uᵀ is the
    covariance.

    Returns
    -------
    influences : array, shape (k, n_blocks)
        Zero for an unknown of which the blocks show nothing.
    degrees_of_freedom : array, shape (k,)
        Of each variance, for Student's t; 0 where there is none.
    """
    k = len(clusters.inverse)
    influences = np.zeros((k, len(clusters.normal)))
    if k == 0:
        return influences, np.zeros(0)
    shown = np.zeros(k)  # trace of the quadratic form, for white noise of unit variance
    squares, across, gram = np.zeros(k), np.zeros(k), np.zeros((k, k, k))
    for segment in _segments(clusters):
        adjusted = [segment.adjusted(normal) for normal in segment.normal]
        for b, (matrix, score) in enumerate(zip(adjusted, segment.scores, strict=True)):
            influences[:, segment.first + b] = matrix @ score
        # Rows, one per block: how white noise enters each unknown's influence, through J_b.
        rows = np.einsum("bci,bij->cbj", np.array(adjusted), segment.normal)
        for c in range(k):
            own = np.diag([float(r @ a[c]) for r, a in zip(rows[c], adjusted, strict=True)])
            own -= rows[c] @ segment.own @ rows[c].T
            common = rows[c] @ segment.borders
            shown[c] += np.trace(own) - np.trace(common @ clusters.inverse @ common.T)
            squares[c] += np.sum(own**2)
            across[c] += np.trace(common @ clusters.inverse @ common.T @ own)
            gram[c] += common.T @ common
    return unbiased(influences, clusters.inverse, shown, squares, across, gram)


def unbiased(
    influences: FloatArray,
    inverse: FloatArray,
    shown: FloatArray,
    squares: FloatArray,
    across: FloatArray,
    gram: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Scale influences to the variance that white noise has, and count degrees of freedom.

    Parameters
    ----------
    influences : array, shape (k, n_blocks)
        Of all blocks; scaled in place.
    inverse : array, shape (k, k)
        Covariance of the unknowns for white noise of unit variance.
    shown, squares, across, gram : array, shape (k,), (k,), (k,), (k, k, k)
        Of each variance as a quadratic form in white noise, which is a part from each block's own
        residuals less what the blocks have in common through the fit: its trace, the sum of the
        squares of the first, the trace of the product of both, and the second as a matrix R of
        R `inverse`.
    """
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
    """Matrices H and O, each shape (n, rank), with H Hᵀ the covariance and Oᵀ H = I."""
    scale = np.sqrt(np.diag(covariance))
    scale = np.where(scale > 0.0, scale, 1.0)
    eigenvalues, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = eigenvalues > _ROUNDING * eigenvalues[-1]
    root = np.sqrt(eigenvalues[kept])
    return vectors[:, kept] * root * scale[:, None], vectors[:, kept] / root / scale[:, None]


def unbiasing(leverages: FloatArray) -> FloatArray:
    """Factor by which a fit has shrunk residuals along directions of these leverages, undone."""
    left = 1.0 - leverages
    return np.where(left > _WHOLE, 1.0 / np.sqrt(np.maximum(left, _WHOLE)), 0.0)


@dataclass(frozen=True, eq=False)
class _Segment:
    """One segment's blocks, and the covariance of all its unknowns for white noise.

    That is `own` + `borders` `inverse` `borders`ᵀ: what is left to the segment's own unknowns if
    the common ones were known, and what they add.
    """

    first: int
    normal: FloatArray
    scores: FloatArray
    own: FloatArray
    borders: FloatArray
    inverse: FloatArray

    def adjusted(self, normal: FloatArray) -> FloatArray:
        """Matrix, shape (k, n), by which a block's scores become its influence."""
        covariance = self.own + self.borders @ self.inverse @ self.borders.T
        half, other = covariance_root(covariance)
        leverages, directions = np.linalg.eigh(half.T @ normal @ half)
        correction = other @ (directions * unbiasing(leverages)) @ directions.T @ half.T
        return self.inverse @ self.borders.T @ correction


def _segments(clusters: Clusters) -> Iterator[_Segment]:
    k = len(clusters.inverse)
    n = clusters.normal.shape[1]
    edges = np.flatnonzero(np.diff(clusters.segments, prepend=-1, append=-1))
    for first, stop in pairwise(edges):
        normal = clusters.normal[first:stop]
        total = normal.sum(axis=0)
        own = np.zeros((n, n))
        states = slice(0, n - k)
        scale = np.sqrt(np.diag(total)[states])
        scales = np.outer(*(np.where(scale > 0.0, scale, 1.0),) * 2)
        own[states, states] = (
            np.linalg.pinv(total[states, states] / scales, rcond=_ROUNDING, hermitian=True) / scales
        )
        borders = np.concatenate((-own[states, states] @ total[states, n - k :], np.eye(k)))
        yield _Segment(
            int(first), normal, clusters.scores[first:stop], own, borders, clusters.inverse
        )
