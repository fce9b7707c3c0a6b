"""Outcome of a sample."""

import numpy as np
from numba import njit

# Outcome of a sample, the last entry of its info, with the values of `Status`.
USED = 0.0
STARTING = 1.0
REJECTED = 2.0


@njit(cache=True, error_model="numpy")
def is_finite(sample):
    """Whether all values of a sample are finite."""
    for value in sample:
        if not abs(value) < np.inf:
            return False
    return True
