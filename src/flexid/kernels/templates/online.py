"""An online estimator that changes its state in place. The coefficients come first in it."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import N_COEFFICIENTS, N_ROWS
    from flexid.kernels.templates.least_squares_gain import take


@njit(cache=True, error_model="numpy")
def step(state, sample, settings):
    """New state and info after one sample; the old state is left as it is."""
    new = state.copy()
    info = np.empty(N_ROWS + 1)
    take(new, sample, settings, info)
    return new, info


@njit(cache=True, error_model="numpy", nogil=True)
def replay(state, samples, settings, coefficients, infos):
    """The same step over all samples; fills the history and returns the last state."""
    current = state.copy()
    for n in range(samples.shape[0]):
        take(current, samples[n], settings, infos[n])
        for i in range(N_COEFFICIENTS):
            coefficients[n, i] = current[i]
    return current
