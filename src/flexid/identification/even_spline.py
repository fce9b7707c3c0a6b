"""Cubic splines through samples at even times, taken at other even times.

SciPy's are for any times, in a module that brings all of its optimisation and takes a third of a
second to import. At even times a spline needs one banded system and four weights.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_banded

FloatArray = NDArray[np.float64]


class EvenSpline:
    """The cubic spline through values at 0, 1, 2, ..., without knots next to either end.

    Parameters
    ----------
    values : array, shape (n,)
        At least four.
    """

    def __init__(self, values: FloatArray) -> None:
        self._values = values
        steps = np.diff(values)
        bands = np.ones((3, len(values)))
        bands[1] = 4.0
        bands[1, 0] = bands[1, -1] = 1.0
        bands[0, 1] = bands[2, -2] = 2.0
        right = np.empty(len(values))
        right[1:-1] = 3.0 * (steps[:-1] + steps[1:])
        right[0] = 0.5 * (5.0 * steps[0] + steps[1])
        right[-1] = 0.5 * (5.0 * steps[-1] + steps[-2])
        self._slopes = solve_banded((1, 1), bands, right)

    def at(self, places: NDArray[np.int_], shift: float, derivative: int = 0) -> FloatArray:
        """Values, or first derivatives, at whole places moved by a shift.

        Parameters
        ----------
        places : array of int, shape (m,)
            Within the spline by more than the shift.
        shift : float
            Of either sign.
        derivative : int, optional
            0 or 1.

        Returns
        -------
        array, shape (m,)
        """
        whole = int(np.floor(shift))
        first, t = places + whole, shift - whole
        rise = self._values[first + 1] - self._values[first]
        here, there = self._slopes[first], self._slopes[first + 1]
        if derivative:
            return (
                6.0 * t * (1.0 - t) * rise
                + (1.0 - t) * (1.0 - 3.0 * t) * here
                + t * (3.0 * t - 2.0) * there
            )
        return (
            self._values[first]
            + t * t * (3.0 - 2.0 * t) * rise
            + t * (1.0 - t) ** 2 * here
            - t * t * (1.0 - t) * there
        )
