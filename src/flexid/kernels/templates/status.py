"""What became of a sample."""

import numpy as np
from numba import njit

# What became of a sample; the last entry of its info. The values are those of `Status`.
USED = 0.0
STARTING = 1.0
REJECTED = 2.0


@njit(cache=True, error_model="numpy")
def is_finite(sample):
    """Whether a sample holds numbers only."""
    for value in sample:
        if not abs(value) < np.inf:
            return False
    return True
