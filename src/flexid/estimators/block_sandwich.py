"""Blocks of a record, and the covariance of least squares whose residuals are correlated.

Filtered residuals are far from white, so the textbook covariance is wrong. Summed over blocks long
enough to be independent of one another, their scores give the right one (`cluster_covariance`).
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.cluster_covariance import covariance_root, unbiased, unbiasing
from flexid.symmetric import eigen

BLOCK_DURATION = 1.0
"""Length of a block in s, if the record has room for `WANTED_BLOCKS` of them."""

WANTED_BLOCKS = 20

_INDEPENDENCE = 10.0  # time constants of the filter that a block spans at least
_AT_ONCE = 4096  # blocks whose matrices are kept in memory together


def block_duration(total: float) -> float:
    """Wanted length of a block in s for a record of a total length in s."""
    return min(BLOCK_DURATION, total / WANTED_BLOCKS)


def block_lengths(
    lengths: Sequence[int],
    sample_times: Sequence[float],  # in s
    filter_rate: float,  # in 1/s
    n_coefficients: int,
) -> list[int]:
    """Divide contiguous recordings into blocks.

    Returns equations in each block, in the recordings' order; no block crosses from one to the
    next.
    """
    total = sum(n * h for n, h in zip(lengths, sample_times, strict=True))
    blocks = []
    for n, sample_time in zip(lengths, sample_times, strict=True):
        blocks += divided(n, block_size(total, sample_time, filter_rate, n_coefficients))
    return blocks


def block_size(total: float, sample_time: float, filter_rate: float, n_coefficients: int) -> int:
    """Equations in a block of a record of a total length in s; the rest as for `block_lengths`."""
    duration = max(block_duration(total), _INDEPENDENCE / filter_rate)
    # A short record gets shorter blocks than wanted rather than no interval at all.
    duration = min(duration, total / (n_coefficients + 3))
    return max(1, round(duration / sample_time))


def divided(n: int, size: int) -> list[int]:
    """Blocks of a size that n equations make.

    What is left over is a block of its own, or belongs to the last one if it is less than half.
    """
    count = max(1, (2 * n + size) // (2 * size))
    return [size] * (count - 1) + [n - (count - 1) * size]


def block_influences(
    regressor: FloatArray,  # (k, n)
    residual: FloatArray,  # (n,)
    inverse: FloatArray,  # (k, k)
    blocks: Sequence[int],
) -> tuple[FloatArray, FloatArray]:
    """How far each block's scores move the coefficients of least squares.

    With L the influences of all coefficients, those of other rows over the same blocks among them,
    L Lᵀ is their covariance.

    Returns shape (k, n_blocks): Zero for a coefficient of which the blocks show nothing.
    degrees_of_freedom : array, shape (k,) Of each variance; 0 where there is none.
    """
    edges = np.concatenate(([0], np.cumsum(blocks, dtype=np.int64)))
    parts = [slice(first, stop) for first, stop in pairwise(edges)]
    k, count = len(inverse), len(parts)
    normal = [regressor[:, part] @ regressor[:, part].T for part in parts]
    scores = [regressor[:, part] @ residual[part] for part in parts]
    return summed_influences(
        np.array(normal).reshape(count, k, k), np.array(scores).reshape(count, k), inverse
    )


def summed_influences(
    normal: FloatArray,  # (n_blocks, k, k)
    scores: FloatArray,  # (n_blocks, k)
    inverse: FloatArray,  # (k, k)
) -> tuple[FloatArray, FloatArray]:
    """As `block_influences`, from what each block sums up.

    This is `cluster_influences` for blocks that have no unknowns of their own, all of them at once:
    a day has a hundred thousand.
    """
    count, k = scores.shape
    influences = np.zeros((k, count))
    if k == 0:
        return influences, np.zeros(0)
    half = covariance_root(inverse)[0]
    shown, squares, across = np.zeros(k), np.zeros(k), np.zeros(k)
    gram = np.zeros((k, k, k))
    for first in range(0, count, _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        leverages, directions = eigen(half.T @ normal[part] @ half)
        moved = half @ directions
        adjusted = (moved * unbiasing(leverages)[:, None, :]) @ moved.transpose(0, 2, 1)
        influences[:, part] = np.einsum("bci,bi->cb", adjusted, scores[part])
        rows = adjusted @ normal[part]  # how white noise enters each coefficient's influence
        own = np.einsum("bci,bci->bc", rows, adjusted)
        common = np.einsum("bci,ij,bcj->bc", rows, inverse, rows, optimize=True)
        shown += np.sum(own - common, axis=0)
        squares += np.sum(own**2, axis=0)
        across += np.sum(own * common, axis=0)
        gram += np.einsum("bci,bcj->cij", rows, rows, optimize=True)
    return unbiased(influences, inverse, shown, squares, across, gram)
