"""Blocks of a record, and the covariance of least squares whose residuals are correlated.

Filtered residuals are far from white, so the textbook covariance is wrong. Summed over blocks long
enough to be independent of one another, their scores give the right one (`cluster_covariance`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.cluster_covariance import covariance_root, unbiased, unbiasing
from flexid.estimators.normal_equations import scaled_inverse
from flexid.symmetric import eigen

BLOCK_DURATION = 1.0
"""Length of a block in s, if the record has room for `WANTED_BLOCKS` of them."""

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
    """As `influences_of`, of the data; zero where no coefficient is sought."""
    edges = np.concatenate(([0], np.cumsum(blocks, dtype=np.int64)))
    parts = [slice(first, stop) for first, stop in pairwise(edges)]
    k, count = len(inverse), len(parts)
    if k == 0 or count == 0:
        return np.zeros((k, count)), np.zeros(k)
    normal = np.array([regressor[:, part] @ regressor[:, part].T for part in parts])
    scores = np.array([regressor[:, part] @ residual[part] for part in parts])
    return influences_of(normal, scores, inverse)


def influences_of(
    normal: FloatArray,  # (n_blocks, k, k)
    scores: FloatArray,  # (n_blocks, k)
    inverse: FloatArray,  # (k, k)
) -> tuple[FloatArray, FloatArray]:
    """How far each block's scores move the coefficients of least squares, shape (k, n_blocks).

    With L the influences of all coefficients, those of other rows over the same blocks among them,
    L Lᵀ is their covariance. Second are the degrees of freedom of each variance, 0 where the blocks
    show nothing. As `cluster_influences` for blocks without unknowns of their own, all at once.
    """
    half = covariance_root(inverse)[0]
    leverages, directions = eigen(half.T @ normal @ half)
    moved = half @ directions
    adjusted = (moved * unbiasing(leverages)[:, None, :]) @ moved.transpose(0, 2, 1)
    influences = np.einsum("bci,bi->cb", adjusted, scores)
    rows = adjusted @ normal  # how white noise enters each coefficient's influence
    own = np.einsum("bci,bci->bc", rows, adjusted)
    common = np.einsum("bci,ij,bcj->bc", rows, inverse, rows, optimize=True)
    shown = np.sum(own - common, axis=0)
    squares, across = np.sum(own**2, axis=0), np.sum(own * common, axis=0)
    gram = np.einsum("bci,bcj->cij", rows, rows, optimize=True)
    return unbiased(influences, inverse, shown, squares, across, gram)


def covariance_of(influences: FloatArray, unknown: NDArray[np.bool_]) -> FloatArray:
    """Covariance, shape (n, n), with infinite variance of what is unknown, shape (n,)."""
    covariance = influences @ influences.T
    covariance[unknown, :] = covariance[:, unknown] = 0.0
    covariance[unknown, unknown] = np.inf
    return covariance


@dataclass(frozen=True, eq=False)
class Blocks:
    """Normal equations that an online estimator has kept, block by block."""

    lengths: FloatArray  # (n_blocks,): samples in each block
    weights: FloatArray  # (n_blocks,): weight of each block, 1 if nothing is forgotten
    # (n_blocks, n_rows, k, k): σ r rᵀ of every row, which may have fewer than k coefficients
    matrices: FloatArray
    vectors: FloatArray  # (n_blocks, n_rows, k): σ r y

    @property
    def fading(self) -> float:
        """Degrees of freedom in fading weights over those in weights of blocks that count alike.

        A block of weight w adds w² to the variance but w to the information; blocks whose weights
        fade like an exponential tell half as much of the spread as the information suggests.
        """
        w, n = self.weights, self.lengths
        alike = np.sum(w * n) ** 2 / np.sum(w**2 * n**2)
        return float(np.sum(w**2 * n) ** 2 / np.sum(w**4 * n**2) / alike)

    def covariance(
        self,
        rows: Sequence[slice],
        values: FloatArray,  # (n_coefficients,)
    ) -> tuple[FloatArray, FloatArray]:
        """Covariance of an estimate, and degrees of freedom for Student's t, 0 where unknown.

        Infinite variance where there are no more blocks than coefficients, or where the data leave
        a coefficient open.
        """
        count = len(self.weights)
        influences = np.zeros((len(values), count))
        freedom = np.zeros(len(values))
        for place, part in enumerate(rows):
            k = part.stop - part.start
            if count <= k:
                continue
            matrices, vectors = self.matrices[:, place, :k, :k], self.vectors[:, place, :k]
            normal = self.weights[:, None, None] * matrices
            scores = self.weights[:, None] * (vectors - matrices @ values[part])
            total = normal.sum(axis=0)
            inverse, free = scaled_inverse(total, np.sqrt(np.diag(total)))
            try:
                influences[part], degrees = influences_of(normal, scores, inverse)
            except np.linalg.LinAlgError:  # of numbers that no drive has
                continue
            freedom[part] = np.where(free, 0.0, degrees * self.fading)
        return covariance_of(influences, freedom == 0.0), freedom
