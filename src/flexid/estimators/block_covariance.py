"""Covariance of an online estimate from the normal equations of blocks that it has kept.

The scores of the blocks at the present estimate are b_B - A_B p, and their spread gives the
covariance, as it does in the batch. Where weights fade, older blocks count less.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.cluster_covariance import Clusters, cluster_influences
from flexid.estimators.scaled_inverse import scaled_inverse


@dataclass(frozen=True, eq=False)
class Blocks:
    """Normal equations, block by block."""

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


def block_covariance(
    rows: Sequence[slice],
    values: FloatArray,  # (n_coefficients,)
    blocks: Blocks,
) -> tuple[FloatArray, FloatArray]:
    """Cluster sandwich with fading weights.

    Returns shape (n_coefficients, n_coefficients): Infinite variance where there are no more
    blocks than coefficients, or where the data leave a coefficient open. degrees_of_freedom :
    array, shape (n_coefficients,) For Student's t; 0 where there is no covariance.
    """
    count = len(blocks.weights)
    influences = np.zeros((len(values), count))
    freedom = np.zeros(len(values))
    for place, part in enumerate(rows):
        k = part.stop - part.start
        if count <= k:
            continue
        weights = blocks.weights
        normal = weights[:, None, None] * blocks.matrices[:, place, :k, :k]
        matrices, vectors = blocks.matrices[:, place, :k, :k], blocks.vectors[:, place, :k]
        scores = weights[:, None] * (vectors - matrices @ values[part])
        total = normal.sum(axis=0)
        scale = np.sqrt(np.diag(total))
        inverse, free = scaled_inverse(total, scale)
        segments = np.zeros(count, dtype=np.int64)
        try:
            found = cluster_influences(Clusters(normal, scores, segments, inverse))
        except np.linalg.LinAlgError:  # of numbers that no drive has: nothing is known of the row
            continue
        influences[part] = found[0]
        freedom[part] = np.where(free, 0.0, found[1] * blocks.fading)
    covariance = influences @ influences.T
    unknown = freedom == 0.0
    covariance[unknown, :] = covariance[:, unknown] = 0.0
    covariance[unknown, unknown] = np.inf
    return covariance, freedom
