"""Inverse of normal equations on what the data determine, in the coefficients' own units."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.symmetric import eigen

NULL = 1e-12
"""Eigenvalue of a matrix scaled to a unit diagonal that counts as zero."""

_PART = 1e-6  # of a coefficient in an open direction, from which on it is free


def scaled_inverse(
    matrix: FloatArray,  # (k, k)
    scale: FloatArray,  # (k,)
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Invert a symmetric matrix on the directions that are not lost in rounding.

    Returns the inverse, shape (k, k), zero along open directions; and which coefficients have a
    part in an open direction, shape (k,).
    """
    scale = np.where(scale > 0.0, scale, 1.0)
    eigenvalues, vectors = eigen(matrix / np.outer(scale, scale))
    kept = eigenvalues > NULL
    inverse = (vectors[:, kept] / eigenvalues[kept]) @ vectors[:, kept].T / np.outer(scale, scale)
    return inverse, np.any(np.abs(vectors[:, ~kept]) > _PART, axis=1)


class Least(NamedTuple):
    """Where a quadratic form is least."""

    values: FloatArray  # (k,): of what is sought
    inverse: FloatArray  # (k, k): of its part of the form's matrix, as of `scaled_inverse`
    # (k,): what has a part in an open direction, along which a value stays what it was
    free: NDArray[np.bool_]


def least_with(
    left: NDArray[np.bool_],  # (n,)
    matrix: FloatArray,  # (n, n)
    values: FloatArray,  # (n,)
) -> Least:
    """Where a quadratic form is least if some of its values are zero, as the rest follows."""
    part = matrix[np.ix_(left, left)]
    inverse, free = scaled_inverse(part, np.sqrt(np.maximum(np.diag(part), 0.0)))
    moved = inverse @ (matrix[np.ix_(left, ~left)] @ values[~left])
    return Least(values[left] + moved, inverse, free)
