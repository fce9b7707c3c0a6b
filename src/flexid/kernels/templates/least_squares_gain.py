"""Recursive least squares whose covariance comes from the scores of blocks."""

from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.block_scores import store_block
    from flexid.kernels.templates.generated import N_BLOCKS, N_COEFFICIENTS, N_ROWS, ROW_STARTS
    from flexid.kernels.templates.status import REJECTED, STARTING, USED, is_finite
    from flexid.kernels.templates.velocity_rows import (
        LEAST_EXPLAINED,
        N_PAST,
        N_SIGNALS,
        ROWS_SIZE,
        forget_rows,
        next_row,
        past,
    )


WIDTH = max([ROW_STARTS[j + 1] - ROW_STARTS[j] for j in range(N_ROWS)]) + N_PAST
SQUARE = WIDTH * WIDTH
N_COUNTS = 6
# Places in the counts; the first three are those of `store_block`.
BLOCKS, CLOCK, BLOCK_LENGTH, SPAN, AGE, PAST_GONE = 0, 1, 2, 3, 4, 5

COUNTS_AT = N_COEFFICIENTS
POWER_AT = COUNTS_AT + N_COUNTS
PAST_AT = POWER_AT + N_ROWS
PEAKS_AT = PAST_AT + N_ROWS * N_PAST
# Normal equations, a matrix per row and then a vector per row: of all samples, of the current
# block, of the blocks before.
EQUATIONS_SIZE = N_ROWS * (SQUARE + WIDTH)
VECTORS = N_ROWS * SQUARE
EQUATIONS_AT = PEAKS_AT + N_COEFFICIENTS
OWN_AT = EQUATIONS_AT + EQUATIONS_SIZE
ENDS_AT = OWN_AT + EQUATIONS_SIZE
LENGTHS_AT = ENDS_AT + N_BLOCKS
STORED_AT = LENGTHS_AT + N_BLOCKS
ROWS_AT = STORED_AT + N_BLOCKS * EQUATIONS_SIZE
STATE_SIZE = ROWS_AT + ROWS_SIZE

# Places in the settings of the law; those of the rows follow.
FORGETTING, LEAST_INFORMATION, LONGEST_BLOCK, MEMORY, FEWEST, N_LAW_SETTINGS = 0, 1, 2, 3, 4, 5

RIDGE = 1e-9  # of the matrix scaled to a unit diagonal: less is lost in rounding
LEAST_TOLERANCE = 1e-5  # part of a regressor that the others must leave over
LEAST_PIVOT = 1e-12  # of a diagonal: what elimination leaves below is the rounding of what it took


@njit(cache=True, error_model="numpy")
def scaled_factor(matrix, n, scale, factor):
    """Cholesky factor of the matrix scaled to a unit diagonal, plus the ridge."""
    for i in range(n):
        scale[i] = 1.0 / sqrt(matrix[i, i]) if matrix[i, i] > 0.0 else 0.0
    for i in range(n):
        for j in range(i + 1):
            total = scale[i] * matrix[i, j] * scale[j]
            if i == j:
                total = 1.0 + RIDGE
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            # Less than the ridge is left only where rounding has made a square negative.
            factor[i, j] = sqrt(max(total, RIDGE)) if i == j else total / factor[j, j]


@njit(cache=True, error_model="numpy")
def least_tolerance(factor, n, wanted, work):
    """Least of the first `wanted` entries of one over the diagonal of the inverse.

    For a unit diagonal: the part of each regressor's square that the others do not explain.
    """
    least = 1.0
    for i in range(wanted):
        square = 0.0
        for j in range(i, n):
            total = 1.0 if j == i else 0.0
            for k in range(i, j):
                total -= factor[j, k] * work[k]
            work[j] = total / factor[j, j]
            square += work[j] * work[j]
        least = min(least, 1.0 / square)
    return least


@njit(cache=True, error_model="numpy")
def forget_unknown(matrix, vector, i):
    """Leave nothing of one unknown in the normal equations."""
    vector[i] = 0.0
    for j in range(matrix.shape[0]):
        matrix[i, j] = 0.0
        matrix[j, i] = 0.0


@njit(cache=True, error_model="numpy")
def eliminate_past(matrix, vector, n):
    """Take the unknown past out of the normal equations; return what it explained."""
    explained = 0.0
    least = np.empty(n)
    for i in range(n):
        least[i] = LEAST_PIVOT * matrix[i, i]
    for q in range(n + N_PAST - 1, n - 1, -1):
        pivot = matrix[q, q]
        if pivot > LEAST_PIVOT * matrix[n, n]:
            explained += vector[q] * vector[q] / pivot
            for i in range(q):
                part = matrix[i, q] / pivot
                vector[i] -= part * vector[q]
                for j in range(q):
                    matrix[i, j] -= part * matrix[q, j]
        forget_unknown(matrix, vector, q)
    for i in range(n):
        if not matrix[i, i] > least[i]:  # the past explains all of it
            forget_unknown(matrix, vector, i)
    return explained


@njit(cache=True, error_model="numpy")
def matrix_of(state, place, j):
    """Matrix of row j of the equations at a place."""
    return state[place + j * SQUARE : place + (j + 1) * SQUARE].reshape((WIDTH, WIDTH))


@njit(cache=True, error_model="numpy")
def vector_of(state, place, j):
    """Vector of row j of the equations at a place."""
    first = place + VECTORS + j * WIDTH
    return state[first : first + WIDTH]


@njit(cache=True, error_model="numpy")
def forget_past(state):
    """Eliminate the unknown past of all rows, once it has decayed or a new recording begins."""
    for j in range(N_ROWS):
        n = ROW_STARTS[j + 1] - ROW_STARTS[j]
        explained = eliminate_past(
            matrix_of(state, EQUATIONS_AT, j), vector_of(state, EQUATIONS_AT, j), n
        )
        state[POWER_AT + j] -= explained
        eliminate_past(matrix_of(state, OWN_AT, j), vector_of(state, OWN_AT, j), n)
    for i in range(PAST_AT, PEAKS_AT):
        state[i] = 0.0
    state[COUNTS_AT + PAST_GONE] = 1.0


@njit(cache=True, error_model="numpy")
def close_block(state, settings):
    """Keep the current block for the covariance and begin another."""
    counts = state[COUNTS_AT:POWER_AT]
    own = state[OWN_AT:ENDS_AT]
    store_block(
        counts,
        state[ENDS_AT:LENGTHS_AT],
        state[LENGTHS_AT:STORED_AT],
        state[STORED_AT:ROWS_AT].reshape((N_BLOCKS, EQUATIONS_SIZE)),
        own,
        counts[SPAN],
        settings[FORGETTING],
        settings[LONGEST_BLOCK],
    )
    counts[SPAN] = 0.0
    for i in range(EQUATIONS_SIZE):
        own[i] = 0.0


@njit(cache=True, error_model="numpy")
def break_off(state, settings):
    """A sample is missing: the next one begins a new recording; nothing that was learnt is lost."""
    counts = state[COUNTS_AT:POWER_AT]
    if counts[SPAN] > 0.0:
        if counts[PAST_GONE] == 0.0:
            forget_past(state)
        close_block(state, settings)
    counts[AGE] = 0.0
    counts[PAST_GONE] = 0.0
    forget_rows(state[ROWS_AT:])


@njit(cache=True, error_model="numpy")
def update_row(j, n, m, state, settings, regressor, target, work):
    """One row's equation; returns innovation and whether its coefficients are determined."""
    start = ROW_STARTS[j]
    matrix, vector = matrix_of(state, EQUATIONS_AT, j), vector_of(state, EQUATIONS_AT, j)
    own_matrix, own_vector = matrix_of(state, OWN_AT, j), vector_of(state, OWN_AT, j)
    values, values_past = state[start:], state[PAST_AT + N_PAST * j :]
    unknowns, scale, step, factor = work[0], work[1], work[2], work[3:]
    fading = settings[FORGETTING]
    innovation = target
    for i in range(m):
        unknowns[i] = values[i] if i < n else values_past[i - n]
        innovation -= regressor[i] * unknowns[i]
    for i in range(m):
        for k in range(m):
            product = regressor[i] * regressor[k]
            matrix[i, k] = fading * matrix[i, k] + product
            own_matrix[i, k] = fading * own_matrix[i, k] + product
        vector[i] = fading * vector[i] + regressor[i] * target
        own_vector[i] = fading * own_vector[i] + regressor[i] * target
    for i in range(n):  # information that is not forgotten, drawn to where the estimate is
        peak = max(state[PEAKS_AT + start + i], matrix[i, i])
        state[PEAKS_AT + start + i] = peak
        kept = (1.0 - fading) * settings[LEAST_INFORMATION] * peak
        matrix[i, i] += kept
        vector[i] += kept * unknowns[i]
    scaled_factor(matrix, m, scale, factor)
    # The ridge holds directions that the data leave open; the others are right after a few samples.
    for i in range(m):
        total = vector[i]
        for k in range(m):
            total -= matrix[i, k] * unknowns[k]
        total *= scale[i]
        for k in range(i):
            total -= factor[i, k] * step[k]
        step[i] = total / factor[i, i]
    for i in range(m - 1, -1, -1):
        total = step[i]
        for k in range(i + 1, m):
            total -= factor[k, i] * step[k]
        step[i] = total / factor[i, i]
        unknowns[i] += scale[i] * step[i]
    power = fading * state[POWER_AT + j] + target * target
    state[POWER_AT + j] = power
    explained = 0.0
    for i in range(n):
        values[i] = unknowns[i]
    for i in range(n, m):
        values_past[i - n] = unknowns[i]
    for i in range(m):
        total = 2.0 * vector[i]
        for k in range(m):
            total -= matrix[i, k] * unknowns[k]
        explained += unknowns[i] * total
    determined = explained > LEAST_EXPLAINED * power
    determined = determined and least_tolerance(factor, m, n, step) > LEAST_TOLERANCE
    for i in range(n):
        determined = determined and scale[i] > 0.0
    return innovation, determined


@njit(cache=True, error_model="numpy")
def take(state, sample, settings, info):
    """Take in one sample: the state changes in place, info receives innovations and a status."""
    law, rows = settings[:N_LAW_SETTINGS], settings[N_LAW_SETTINGS:]
    counts = state[COUNTS_AT:POWER_AT]
    for j in range(N_ROWS):
        info[j] = np.nan
    if not is_finite(sample):
        break_off(state, law)
        info[N_ROWS] = REJECTED
        return
    info[N_ROWS] = STARTING
    signals = np.empty(N_SIGNALS)
    if not next_row(state[ROWS_AT:], sample, rows, signals):
        return
    if counts[PAST_GONE] == 0.0 and counts[AGE] >= law[MEMORY]:
        forget_past(state)
        if counts[SPAN] > 0.0:
            close_block(state, law)
    elif counts[PAST_GONE] != 0.0 and counts[SPAN] >= counts[BLOCK_LENGTH]:
        close_block(state, law)
    regressor = np.empty(WIDTH)
    work = np.empty((3 + WIDTH, WIDTH))
    n_past = N_PAST if counts[PAST_GONE] == 0.0 else 0
    all_determined = counts[CLOCK] >= law[FEWEST]
    for j in range(N_ROWS):
        start = ROW_STARTS[j]
        n = ROW_STARTS[j + 1] - start
        for i in range(n):
            regressor[i] = signals[start + i]
        if n_past > 0:
            past(state[ROWS_AT:], rows, regressor, n)
        target = signals[N_COEFFICIENTS + j]
        info[j], determined = update_row(j, n, n + n_past, state, law, regressor, target, work)
        all_determined = all_determined and determined
    counts[AGE] += 1.0
    counts[SPAN] += 1.0
    counts[CLOCK] += 1.0
    if all_determined:
        info[N_ROWS] = USED
