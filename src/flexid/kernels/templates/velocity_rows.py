"""Rows of the regression from sampled positions and velocities."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import (
        N_COEFFICIENTS,
        N_INPUTS,
        N_ROWS,
        N_STATES,
        regressors,
    )


SAMPLE_SIZE = N_STATES + N_INPUTS  # coordinate and velocity of each row in turn, inputs
N_SIGNALS = N_COEFFICIENTS + N_ROWS
N_PAST = 0  # an increment remembers nothing
LEAST_EXPLAINED = 0.05  # part of a left-hand side to explain: increments are noisy
ROWS_SIZE = 1 + N_SIGNALS + N_ROWS + N_INPUTS

# Places in the settings of the rows.
SAMPLE_TIME, ZERO_ORDER, CONSTANTS = 0, 1, 2


@njit(cache=True, error_model="numpy")
def forget_rows(memory):
    """Start anew, as before the first sample."""
    for i in range(memory.shape[0]):
        memory[i] = 0.0


@njit(cache=True, error_model="numpy")
def past(memory, settings, regressor, first):
    """Nothing is remembered of earlier times."""


@njit(cache=True, error_model="numpy")
def next_row(memory, sample, settings, signals):
    """Take in one sample; return whether there is a row: regressors, then left-hand sides.

    The increment of each velocity over the interval, per second, against the regressor's mean over
    it: the Stieltjes integral of r dv, which needs no acceleration.
    """
    h = settings[SAMPLE_TIME]
    constants = settings[CONSTANTS:]
    before = memory[1 : 1 + N_SIGNALS]
    velocities = memory[1 + N_SIGNALS : 1 + N_SIGNALS + N_ROWS]
    inputs = memory[1 + N_SIGNALS + N_ROWS : ROWS_SIZE]
    ready = memory[0] > 0.0
    memory[0] += 1.0
    now = np.empty(N_SIGNALS)
    x, u = sample[:N_STATES], sample[N_STATES:]
    if ready:
        held = settings[ZERO_ORDER] != 0.0
        regressors(x, inputs if held else u, constants, now[:N_COEFFICIENTS], now[N_COEFFICIENTS:])
        for i in range(N_COEFFICIENTS):
            signals[i] = 0.5 * (before[i] + now[i])
        for j in range(N_ROWS):
            known = 0.5 * (before[N_COEFFICIENTS + j] + now[N_COEFFICIENTS + j])
            signals[N_COEFFICIENTS + j] = (x[2 * j + 1] - velocities[j]) / h - known
    regressors(x, u, constants, before[:N_COEFFICIENTS], before[N_COEFFICIENTS:])
    for j in range(N_ROWS):
        velocities[j] = x[2 * j + 1]
    for j in range(N_INPUTS):
        inputs[j] = u[j]
    return ready
