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
from flexid.estimators.cluster_covariance import Clusters, cluster_influences
from flexid.estimators.normal_equations import scaled_inverse

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
                clusters = Clusters(normal, scores, np.arange(count), inverse)
                influences[part], degrees = cluster_influences(clusters)
            except np.linalg.LinAlgError:  # of numbers that no drive has
                continue
            freedom[part] = np.where(free, 0.0, degrees * self.fading)
        return covariance_of(influences, freedom == 0.0), freedom
