"""Observer of Huang (2003), sample by sample."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.kernels.templates.generated import *
    from flexid.kernels.templates.status import *


NO_INNOVATION = (np.nan,) * N_ROWS


@inner
def take_in(current, sample, fixed):
    """Return the new state, innovations and status, as tuples, which stay in registers."""
    if not is_finite(sample):
        return (0.0,) + current[1:], NO_INNOVATION, REJECTED
    current, innovation = advance(current, sample, fixed)
    # With a constant gain there is no measure of whether the data determine the coefficients.
    return current, innovation, STARTING


@inner
def as_array(current):
    """Return the state as an array."""
    state = np.empty(STATE_SIZE)
    for i in range(STATE_SIZE):
        state[i] = current[i]
    return state


@njit(cache=True, error_model="numpy")
def step(state, sample, settings):
    """Return the new state and info after one sample; the old state is unchanged."""
    one = as_sample(sample.reshape((1, SAMPLE_SIZE)), 0)
    current, innovation, status = take_in(as_state(state), one, as_settings(settings))
    info = np.empty(N_ROWS + 1)
    for j in range(N_ROWS):
        info[j] = innovation[j]
    info[N_ROWS] = status
    return as_array(current), info


@njit(cache=True, error_model="numpy")
def replay(state, samples, settings, coefficients, infos):
    """Apply the step to all samples, fill the history and return the last state."""
    current = as_state(state)
    fixed = as_settings(settings)
    for n in range(samples.shape[0]):
        current, innovation, status = take_in(current, as_sample(samples, n), fixed)
        for i in range(N_COEFFICIENTS):
            coefficients[n, i] = current[1 + i]
        for j in range(N_ROWS):
            infos[n, j] = innovation[j]
        infos[n, N_ROWS] = status
    return as_array(current)
