"""Normal equations, solved on what the data determine; those of segments are arrows."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from flexid.arrays import FloatArray


# Divide and conquer, NumPy's, does not converge for some good matrix in a million.
def eigen(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ascending eigenvalues, (..., n), and vectors, in columns, of symmetric matrices."""
    try:
        eigenvalues, vectors = np.linalg.eigh(matrices)
    except np.linalg.LinAlgError:
        if not np.isfinite(matrices).all():
            raise
        eigenvalues, vectors = np.empty(matrices.shape[:-1]), np.empty(matrices.shape)
        for place in np.ndindex(matrices.shape[:-2]):
            eigenvalues[place], vectors[place] = linalg.eigh(matrices[place], driver="ev")
    return eigenvalues, vectors


def pseudo_inverse(matrices: FloatArray, null: float) -> FloatArray:
    """Pseudo-inverses of symmetric matrices; eigenvalues to `null` times the largest are zero."""
    eigenvalues, vectors = eigen(matrices)
    sizes = np.abs(eigenvalues)
    kept = sizes > null * sizes.max(axis=-1, keepdims=True, initial=0.0)
    inverses = np.where(kept, 1.0, 0.0) / np.where(kept, eigenvalues, 1.0)
    return (vectors * inverses[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def scaled_pseudo_inverse(matrices: FloatArray, null: float) -> FloatArray:
    """Pseudo-inverses of symmetric matrices, each scaled to a unit diagonal first."""
    scale = np.sqrt(matrices.diagonal(axis1=1, axis2=2))
    scale = np.where(scale > 0.0, scale, 1.0)
    scales = scale[:, :, None] * scale[:, None, :]
    return pseudo_inverse(matrices / scales, null) / scales


NULL = 1e-12  # eigenvalue of a matrix scaled to a unit diagonal that counts as zero

_PART = 1e-6  # of a coefficient in an open direction, from which on it is free


def scaled_inverse(
    matrix: FloatArray,  # (k, k)
    scale: FloatArray,  # (k,)
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Inverse, (k, k), on directions not lost in rounding, and which coefficients are open."""
    scale = np.where(scale > 0.0, scale, 1.0)
    scales = scale[:, None] * scale
    eigenvalues, vectors = eigen(matrix / scales)
    kept = eigenvalues > NULL
    inverse = (vectors[:, kept] / eigenvalues[kept]) @ vectors[:, kept].T / scales
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


@dataclass(frozen=True, eq=False)
class Reduced:
    """What is left for the coefficients once the initial states are eliminated."""

    information: FloatArray  # (k, k): matrix of the reduced equations
    scores: FloatArray  # (k, n_segments): right-hand side, segment by segment
    # (k, k): inverse of the information on the directions that the data determine
    inverse: FloatArray
    # (k,): coefficients that have a part in a direction that the data leave open
    free: NDArray[np.bool_]
    values_step: FloatArray  # (k,): solution for the coefficients, zero along open directions
    states_step: FloatArray  # (n_segments, n_states): solution for the initial states
    # fall of the sum of squares that the equations predict for this step, if undamped
    decrement: float
    # (n_segments,): the same of each segment's part, if the coefficients stay as they are
    by_states: FloatArray


# The initial state s of a segment touches that segment only: the matrix is block-diagonal, A_j, but
# for a border B_j. Eliminating the initial states leaves as many equations as coefficients,
#     (Σ C_j - B_jᵀ A_j⁻¹ B_j) dp = Σ b_j - B_jᵀ A_j⁻¹ a_j.
def solve_arrow(
    normal: FloatArray,  # (n_segments, n, n)
    gradient: FloatArray,  # (n_segments, n)
    n_states: int,
    damping: float = 0.0,
) -> Reduced:
    """Solve the segments' normal equations together."""
    own = normal[:, :n_states, :n_states].copy()
    border = normal[:, :n_states, n_states:]
    common = normal[:, n_states:, n_states:].sum(axis=0)
    scale = np.sqrt(common.diagonal())
    if damping:
        places = np.arange(n_states)
        own[:, places, places] *= 1.0 + damping
        common = common + damping * np.diag(common.diagonal())
    own_inverse = scaled_pseudo_inverse(own, NULL)
    weights = own_inverse @ border
    by_own = gradient[:, :n_states, None]
    states_alone = own_inverse @ by_own
    every = len(normal) * n_states, len(common)
    information = common - border.reshape(every).T @ weights.reshape(every)
    information = 0.5 * (information + information.T)
    scores = (gradient[:, n_states:] - (border * states_alone).sum(axis=1)).T
    # Scaled by the border's own size: what the initial states explain in full is lost in rounding.
    inverse, free = scaled_inverse(information, scale)
    total = scores.sum(axis=1)
    values_step = inverse @ total
    by_states = (states_alone * by_own).sum(axis=(1, 2))
    return Reduced(
        information,
        scores,
        inverse,
        free,
        values_step,
        states_alone[:, :, 0] - weights @ values_step,
        float(total @ values_step + by_states.sum()),
        by_states,
    )
