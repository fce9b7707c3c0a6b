"""Least squares in which some unknowns must not be negative.

SciPy has the same, in a module that takes a third of a second to import; here the unknowns are few
and hundreds of problems are solved, most of which need no bound at all.
"""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_ROUNDING = 1e-12  # of the target's norm: what is left of a derivative that is zero


def nonnegative_least_squares(
    matrix: FloatArray, target: FloatArray, bounded: NDArray[np.bool_]
) -> tuple[FloatArray, float]:
    """Minimise the sum of squares of ``matrix @ values - target``.

    The active-set method of Lawson and Hanson (Solving Least Squares Problems, 1974, ch. 23), which
    starts here from the solution without bounds.

    Parameters
    ----------
    matrix : array, shape (n, k)
        Its columns' size is of no account.
    target : array, shape (n,)
    bounded : array of bool, shape (k,)
        Which values must not be negative.

    Returns
    -------
    values : array, shape (k,)
    misfit : float
        The least sum of squares.
    """
    norms = np.linalg.norm(matrix, axis=0)
    norms = np.where(norms > 0.0, norms, 1.0)
    columns = matrix / norms
    least_slope = _ROUNDING * float(np.linalg.norm(target))
    positive = np.ones(len(norms), dtype=np.bool_)  # the others are zero
    values = _solution(columns, target, positive)
    while (negative := bounded & (values < 0.0)).any():
        positive &= ~negative
        values = _solution(columns, target, positive)
    # Whatever would now lower the sum of squares most may become positive again; what does not stay
    # so was brought in by rounding.
    refused = np.zeros_like(positive)
    for _ in range(3 * len(norms)):
        residual = target - columns @ values
        slopes = np.where(positive | refused, 0.0, columns.T @ residual)
        entering = int(np.argmax(slopes))
        if slopes[entering] <= least_slope:
            break
        positive[entering] = True
        values, positive = _feasible(columns, target, values, positive, bounded)
        refused[entering] = not positive[entering]
    residual = target - columns @ values
    return values / norms, float(residual @ residual)


def _feasible(
    columns: FloatArray,
    target: FloatArray,
    values: FloatArray,
    positive: NDArray[np.bool_],
    bounded: NDArray[np.bool_],
) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Go from values towards the solution for what is positive; what reaches zero stays there."""
    wanted = _solution(columns, target, positive)
    while (falling := positive & bounded & (wanted < 0.0)).any():
        shares = values[falling] / (values[falling] - wanted[falling])
        values = values + shares.min() * (wanted - values)
        ended = np.flatnonzero(falling)[shares == shares.min()]
        values[ended] = 0.0
        positive = positive.copy()
        positive[ended] = False
        wanted = _solution(columns, target, positive)
    return wanted, positive


def _solution(columns: FloatArray, target: FloatArray, positive: NDArray[np.bool_]) -> FloatArray:
    values = np.zeros(columns.shape[1])
    values[positive] = np.linalg.lstsq(columns[:, positive], target)[0]
    return values
