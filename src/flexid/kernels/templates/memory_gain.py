"""Estimators that remember products of regressors.

ADJUGATE says whether the law is DREM's or the gradient's.
"""

from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import ADJUGATE, N_COEFFICIENTS, N_ROWS, ROW_STARTS
    from flexid.kernels.templates.status import REJECTED, STARTING, USED, is_finite
    from flexid.kernels.templates.velocity_rows import (
        N_SIGNALS,
        ROWS_SIZE,
        SAMPLE_TIME,
        forget_rows,
        next_row,
    )


WIDTH = max([ROW_STARTS[j + 1] - ROW_STARTS[j] for j in range(N_ROWS)])
SQUARE = WIDTH * WIDTH
CLOCK_AT = N_COEFFICIENTS
LARGEST_AT = CLOCK_AT + 1  # determinant of each row so far
PEAKS_AT = LARGEST_AT + N_ROWS
MATRIX_AT = PEAKS_AT + N_COEFFICIENTS
VECTOR_AT = MATRIX_AT + N_ROWS * SQUARE
ROWS_AT = VECTOR_AT + N_ROWS * WIDTH
STATE_SIZE = ROWS_AT + ROWS_SIZE

# Places in the settings of the law; those of the rows follow.
FORGETTING, GAIN, FEWEST, N_LAW_SETTINGS = 0, 1, 2, 3

LEAST_TOLERANCE = 1e-5  # part of a regressor that the others must leave over


@njit(cache=True, error_model="numpy")
def cholesky(matrix, n):
    """Overwrite the lower half by the Cholesky factor; return the least pivot, squared."""
    least = np.inf
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i == j:
                least = min(least, total)
                matrix[i, i] = sqrt(max(total, 1e-300))
            else:
                matrix[i, j] = total / matrix[j, j]
    return least


@njit(cache=True, error_model="numpy")
def cholesky_solve(factor, n, b):
    """Overwrite b by the solution."""
    for i in range(n):
        total = b[i]
        for k in range(i):
            total -= factor[i, k] * b[k]
        b[i] = total / factor[i, i]
    for i in range(n - 1, -1, -1):
        total = b[i]
        for k in range(i + 1, n):
            total -= factor[k, i] * b[k]
        b[i] = total / factor[i, i]


@njit(cache=True, error_model="numpy")
def scaled_equations(j, n, state, values, matrix, error):
    """The row's memory A and B - A p, made dimensionless by the largest that A's diagonal was."""
    start = ROW_STARTS[j]
    memory = state[MATRIX_AT + j * SQUARE : MATRIX_AT + (j + 1) * SQUARE].reshape((WIDTH, WIDTH))
    vector = state[VECTOR_AT + j * WIDTH : VECTOR_AT + (j + 1) * WIDTH]
    for i in range(n):
        peak = state[PEAKS_AT + start + i]
        error[i] = vector[i]
        for k in range(n):
            error[i] -= memory[i, k] * values[k]
            other = state[PEAKS_AT + start + k]
            scale = sqrt(peak * other)
            matrix[i, k] = memory[i, k] / scale if scale > 0.0 else 0.0
        error[i] = error[i] / sqrt(peak) if peak > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def update_row(j, n, state, settings, signals, h, matrix, error):
    """One row's equation; returns innovation and whether its coefficients are determined."""
    start = ROW_STARTS[j]
    memory = state[MATRIX_AT + j * SQUARE : MATRIX_AT + (j + 1) * SQUARE].reshape((WIDTH, WIDTH))
    vector = state[VECTOR_AT + j * WIDTH : VECTOR_AT + (j + 1) * WIDTH]
    values, regressor = state[start : start + n], signals[start : start + n]
    target = signals[N_COEFFICIENTS + j]
    innovation = target
    for i in range(n):
        innovation -= regressor[i] * values[i]
        for k in range(n):
            memory[i, k] = settings[FORGETTING] * memory[i, k] + h * regressor[i] * regressor[k]
        vector[i] = settings[FORGETTING] * vector[i] + h * regressor[i] * target
        peak = PEAKS_AT + start + i
        state[peak] = max(state[peak], memory[i, i])
    scaled_equations(j, n, state, values, matrix, error)
    gain = settings[GAIN] * h
    if ADJUGATE:  # every coefficient alone, by the determinant: p' = g D (adj(A) B - D p) / max D²
        least = cholesky(matrix, n)
        determinant = 1.0
        for i in range(n):
            determinant *= matrix[i, i] * matrix[i, i] * state[PEAKS_AT + start + i]
        if least > 1e-9:
            state[LARGEST_AT + j] = max(state[LARGEST_AT + j], determinant)
            cholesky_solve(matrix, n, error)
            share = determinant / state[LARGEST_AT + j]
            gain *= share * share
            gain /= 1.0 + gain
        else:
            gain = 0.0
    else:  # p' = G (B - A p), implicit in p
        for i in range(n):
            for k in range(n):
                matrix[i, k] = gain * matrix[i, k] + (1.0 if i == k else 0.0)
        least = cholesky(matrix, n)
        cholesky_solve(matrix, n, error)
    for i in range(n):
        peak = state[PEAKS_AT + start + i]
        values[i] += gain * error[i] / sqrt(peak) if peak > 0.0 else 0.0
    # Of the memory as it is, whatever the law
    scaled_equations(j, n, state, values, matrix, error)
    return innovation, cholesky(matrix, n) > LEAST_TOLERANCE


@njit(cache=True, error_model="numpy")
def take(state, sample, settings, info):
    """Take in one sample: the state changes in place, info receives innovations and a status."""
    law, rows = settings[:N_LAW_SETTINGS], settings[N_LAW_SETTINGS:]
    for j in range(N_ROWS):
        info[j] = np.nan
    if not is_finite(sample):
        forget_rows(state[ROWS_AT:])
        info[N_ROWS] = REJECTED
        return
    info[N_ROWS] = STARTING
    signals = np.empty(N_SIGNALS)
    if not next_row(state[ROWS_AT:], sample, rows, signals):
        return
    all_determined = state[CLOCK_AT] >= law[FEWEST]
    matrix, error = np.empty((WIDTH, WIDTH)), np.empty(WIDTH)
    for j in range(N_ROWS):
        n = ROW_STARTS[j + 1] - ROW_STARTS[j]
        info[j], determined = update_row(
            j, n, state, law, signals, rows[SAMPLE_TIME], matrix, error
        )
        all_determined = all_determined and determined
    state[CLOCK_AT] += 1.0
    if all_determined:
        info[N_ROWS] = USED
