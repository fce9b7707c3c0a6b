"""Solution of normal equations on the directions that the data determine."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from flexid.arrays import FloatArray


# NumPy's divide and conquer fails to converge for about one valid matrix in a million.
def eigen(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return ascending eigenvalues, (..., n), and eigenvectors (columns) of symmetric matrices."""
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
    """Invert symmetric matrices; eigenvalues up to `null` times the largest count as zero."""
    eigenvalues, vectors = eigen(matrices)
    sizes = np.abs(eigenvalues)
    kept = sizes > null * sizes.max(axis=-1, keepdims=True, initial=0.0)
    inverses = np.where(kept, 1.0, 0.0) / np.where(kept, eigenvalues, 1.0)
    return (vectors * inverses[..., None, :]) @ np.swapaxes(vectors, -1, -2)


def scaled_pseudo_inverse(matrices: FloatArray, null: float) -> FloatArray:
    """Return `pseudo_inverse` of symmetric matrices, each scaled to a unit diagonal first."""
    scale = np.sqrt(matrices.diagonal(axis1=1, axis2=2))
    scale = np.where(scale > 0.0, scale, 1.0)
    scales = scale[:, :, None] * scale[:, None, :]
    return pseudo_inverse(matrices / scales, null) / scales


NULL = 1e-12  # eigenvalues up to this count as zero in a matrix with a unit diagonal

_INVISIBLE = 1e-140  # scale of an unknown without effect: the square of its inverse overflows

_OPEN_COMPONENT = 1e-6  # component in an undetermined direction of an undetermined coefficient


def scaled_inverse(
    matrix: FloatArray,  # (k, k)
    scale: FloatArray,  # (k,)
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Invert on determined directions, (k, k); return a mask of undetermined coefficients too."""
    scale = np.where(scale > _INVISIBLE, scale, 1.0)
    scales = scale[:, None] * scale
    eigenvalues, vectors = eigen(matrix / scales)
    kept = eigenvalues > NULL
    inverse = (vectors[:, kept] / eigenvalues[kept]) @ vectors[:, kept].T / scales
    return inverse, np.any(np.abs(vectors[:, ~kept]) > _OPEN_COMPONENT, axis=1)


class Least(NamedTuple):
    """Minimum of a quadratic form in k values."""

    values: FloatArray  # (k,): values at the minimum
    inverse: FloatArray  # (k, k): inverse, by `scaled_inverse`, of the form's matrix
    # (k,): mask of values with a component in an undetermined direction, which stays unchanged
    free: NDArray[np.bool_]


def least_with(
    left: NDArray[np.bool_],  # (n,)
    matrix: FloatArray,  # (n, n)
    values: FloatArray,  # (n,)
) -> Least:
    """Minimise a quadratic form with minimum `values` after setting those outside `left` to 0."""
    part = matrix[np.ix_(left, left)]
    inverse, free = scaled_inverse(part, np.sqrt(np.maximum(np.diag(part), 0.0)))
    moved = inverse @ (matrix[np.ix_(left, ~left)] @ values[~left])
    return Least(values[left] + moved, inverse, free)


@dataclass(frozen=True, eq=False)
class Reduced:
    """Normal equations of k coefficients after elimination of the initial states."""

    information: FloatArray  # (k, k): matrix of the reduced equations
    scores: FloatArray  # (k, n_segments): right-hand side, one column per segment
    # (k, k): inverse of the information on the directions that the data determine
    inverse: FloatArray
    # (k,): mask of coefficients with a component in an undetermined direction
    free: NDArray[np.bool_]
    values_step: FloatArray  # (k,): solution for the coefficients, 0 in undetermined directions
    states_step: FloatArray  # (n_segments, n_states): solution for the initial states
    # predicted fall of the sum of squares by this step, if undamped
    decrement: float
    # (n_segments,): predicted fall of each segment's sum of squares with fixed coefficients
    by_states: FloatArray


# The initial state of a segment affects that segment only. So the matrix is block-diagonal, A_j,
# with a border B_j. Eliminating the initial states leaves one equation per coefficient,
#     (Σ C_j - B_jᵀ A_j⁻¹ B_j) dp = Σ b_j - B_jᵀ A_j⁻¹ a_j.
def solve_arrow(
    normal: FloatArray,  # (n_segments, n, n)
    gradient: FloatArray,  # (n_segments, n)
    n_states: int,
    damping: float = 0.0,
) -> Reduced:
    """Solve the normal equations of all segments by eliminating the initial states."""
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
    # The scale before elimination shows which directions the initial states explain in full.
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
