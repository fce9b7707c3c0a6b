"""Rows of the regression from sampled positions, filtered sample by sample."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import (
        HELD,
        N_COEFFICIENTS,
        N_INPUTS,
        N_ROWS,
        N_SIGNALS,
        sampled_parts,
        velocity_factors,
    )


SAMPLE_SIZE = N_ROWS + N_INPUTS  # coordinates, inputs
N_PAST = 2  # sequences of which the filter's memory of earlier times consists
LEAST_EXPLAINED = 0.5  # part of a left-hand side to explain: of filtered noise it is a hundredth
ROWS_SIZE = 1 + 3 * SAMPLE_SIZE + 5 * N_SIGNALS  # and the samples on either side of these three

# Places in the settings of the rows. Half a window is the samples on either side that a velocity
# estimate looks at: 0 where none is needed.
SAMPLE_TIME, ZERO_ORDER, POLE, HALF_WINDOW, CONSTANTS = 0, 1, 2, 3, 4


@njit(cache=True, error_model="numpy")
def forget_rows(memory):
    """Start anew, as before the first sample."""
    for i in range(memory.shape[0]):
        memory[i] = 0.0


@njit(cache=True, error_model="numpy")
def past(memory, settings, regressor, first):
    """What the filter may remember of the time before it started, at its latest row: z^i, i z^i."""
    rows = memory[0] - (2.0 * settings[HALF_WINDOW] + 3.0)
    decayed = settings[POLE] ** rows
    regressor[first] = decayed
    regressor[first + 1] = rows * decayed


@njit(cache=True, error_model="numpy")
def next_row(memory, sample, settings, signals):
    """Take in one sample; return whether there is a row: regressors, then left-hand sides.

    As `filter_recording` of the state-variable filter, by the sample. Positions and inputs lag by
    half a window, so that velocities can be slopes of straight lines fitted about them.
    """
    h = settings[SAMPLE_TIME]
    zero_order = settings[ZERO_ORDER] != 0.0
    pole = settings[POLE]
    half = int(settings[HALF_WINDOW])
    constants = settings[CONSTANTS:]
    width = 2 * half + 3  # samples that are kept: a second difference at the middle one
    window = memory[1 : 1 + width * SAMPLE_SIZE].reshape((width, SAMPLE_SIZE))
    kept = memory[1 + width * SAMPLE_SIZE :].reshape((5, N_SIGNALS))
    before, long_before, end_before = kept[0], kept[1], kept[2]
    once, twice = kept[3], kept[4]
    for i in range(width - 1):
        for j in range(SAMPLE_SIZE):
            window[i, j] = window[i + 1, j]
    for j in range(SAMPLE_SIZE):
        window[width - 1, j] = sample[j]
    memory[0] += 1.0
    count = memory[0]
    if count < 2 * half + 1:
        return False
    middle = width - 1 - half
    x = np.zeros(2 * N_ROWS)
    now = np.empty(N_SIGNALS)
    end_now = np.empty(N_SIGNALS)
    for j in range(N_ROWS):
        x[2 * j] = window[middle, j]
        if half > 0:
            slope = 0.0
            for i in range(1, half + 1):
                slope += i * (window[middle + i, j] - window[middle - i, j])
            x[2 * j + 1] = 3.0 * slope / (h * half * (half + 1) * (2 * half + 1))
    sampled_parts(x, window[middle, N_ROWS:], constants, now)
    if zero_order and count > 2 * half + 1:
        sampled_parts(x, window[middle - 1, N_ROWS:], constants, end_now)
    else:
        for i in range(N_SIGNALS):
            end_now[i] = now[i]
    if count >= width:
        factors = np.empty((N_SIGNALS, N_ROWS))
        velocity_factors(constants, factors)
        rate = 1.0 / h
        for i in range(N_SIGNALS):
            if HELD[i]:
                inner = end_before[i] + before[i]
                value = (1.0 / 6.0) * (long_before[i] + 2.0 * inner + end_now[i])
            else:
                value = (1.0 / 12.0) * (long_before[i] + 10.0 * before[i] + now[i])
            for j in range(N_ROWS):
                difference = window[middle, j] - window[middle - 2, j]
                value += factors[i, j] * (0.5 * rate * difference)
            if i >= N_COEFFICIENTS:
                j = i - N_COEFFICIENTS
                change = window[middle, j] - window[middle - 1, j]
                change_before = window[middle - 1, j] - window[middle - 2, j]
                value = rate * rate * (change - change_before) - value
            once[i] = pole * once[i] + (1.0 - pole) * value
            twice[i] = pole * twice[i] + (1.0 - pole) * once[i]
            signals[i] = twice[i]
    for i in range(N_SIGNALS):
        long_before[i] = before[i]
        before[i] = now[i]
        end_before[i] = end_now[i]
    return count >= width
