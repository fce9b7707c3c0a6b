"""Eigenvalues of symmetric matrices, and their inverses, whatever LAPACK makes of one."""

import numpy as np
from scipy import linalg

from flexid.arrays import FloatArray


def eigen(matrices: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues, in ascending order, and eigenvectors of symmetric matrices.

    Divide and conquer, which NumPy calls, does not converge for some matrix in a million, although
    nothing is wrong with it; these are left to another of LAPACK's algorithms.

    Parameters
    ----------
    matrices : array, shape (..., n, n)
        Symmetric but for rounding.

    Returns
    -------
    eigenvalues : array, shape (..., n)
    vectors : array, shape (..., n, n)
        A vector in each column.

    Raises
    ------
    numpy.linalg.LinAlgError
        If LAPACK gives up a matrix that is not finite.
    """
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
    """Pseudo-inverses of symmetric matrices.

    Parameters
    ----------
    matrices : array, shape (..., n, n)
        Symmetric but for rounding.
    null : float
        Size of an eigenvalue over that of the largest, up to which it counts as zero.

    Returns
    -------
    array, shape (..., n, n)

    Raises
    ------
    numpy.linalg.LinAlgError
        If LAPACK gives up a matrix that is not finite.
    """
    eigenvalues, vectors = eigen(matrices)
    sizes = np.abs(eigenvalues)
    kept = sizes > null * sizes.max(axis=-1, keepdims=True, initial=0.0)
    inverses = np.where(kept, 1.0, 0.0) / np.where(kept, eigenvalues, 1.0)
    return (vectors * inverses[..., None, :]) @ np.swapaxes(vectors, -1, -2)
