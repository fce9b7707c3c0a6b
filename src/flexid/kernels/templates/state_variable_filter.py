"""Both sides of every row, filtered over a whole recording of a log."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import (
        HELD,
        N_COEFFICIENTS,
        N_ROWS,
        N_SIGNALS,
        inner,
        sampled_parts,
        velocity_factors,
    )


TILE = 256  # samples that are filtered together, signal by signal: they stay in the nearest cache


@inner
def rules(wanted, zero_order, weights):
    """Weights of a signal at samples k - 2, k - 1 (before and after its jump) and k, in columns.

    Held inputs jump at the samples and are taken as linear in between; whatever has no input is
    smooth, and Numerov's rule is of fourth order for it.
    """
    for a in range(wanted.shape[0]):
        held = HELD[wanted[a]]
        end = 1.0 / 6.0 if held else 1.0 / 12.0
        weights[0, a] = end
        weights[1, a] = 2.0 / 6.0 if held and zero_order else 0.0
        weights[2, a] = (2.0 if zero_order else 4.0) / 6.0 if held else 10.0 / 12.0
        weights[3, a] = end


@njit(cache=True, error_model="numpy", nogil=True, fastmath={"contract"})
def filter_recording(record, constants, sample_time, pole, zero_order, wanted, filtered, at):
    """Double integrals of both sides of every row over two intervals, then smoothed twice.

    The record is positions, velocities and inputs, a row for each sample.
    The second difference of a position is the integral of its acceleration over two intervals,
    weighted by a triangle. That integral is taken by a three-sample rule for every signal, and
    both sides pass the filter ((1 - pole) / (1 - pole/z))^2. Row i of `filtered` receives the
    regressor of coefficient i, row N_COEFFICIENTS + j the left-hand side of row j, known part
    subtracted, from column `at` on; only the rows `wanted` are touched.
    """
    positions, velocities, inputs = record
    n_wanted = wanted.shape[0]
    every = np.empty((N_SIGNALS, N_ROWS))
    velocity_factors(constants, every)
    factors = np.empty((N_ROWS, n_wanted))
    acceleration = np.zeros((N_ROWS, n_wanted))  # 1 where the signal is a row's left-hand side
    sign = np.ones(n_wanted)
    for a in range(n_wanted):
        if wanted[a] >= N_COEFFICIENTS:
            acceleration[wanted[a] - N_COEFFICIENTS, a] = 1.0
            sign[a] = -1.0
        for j in range(N_ROWS):
            factors[j, a] = sign[a] * every[wanted[a], j]
    weights = np.empty((4, n_wanted))
    rules(wanted, zero_order, weights)
    weights *= sign
    x = np.zeros(2 * N_ROWS)
    parts = np.empty(N_SIGNALS)
    # Signals over a tile, two samples before it first: with the input from each sample on, and up
    # to it.
    after = np.zeros((n_wanted, TILE + 2))
    until = np.zeros((n_wanted, TILE + 2)) if zero_order else after
    slope = np.empty((N_ROWS, TILE))
    curvature = np.empty((N_ROWS, TILE))
    value = np.empty(TILE)
    once = np.zeros(n_wanted)
    twice = np.zeros(n_wanted)
    gain = 1.0 - pole
    rate = 1.0 / sample_time
    length = positions.shape[0]
    for first in range(0, length, TILE):
        count = min(TILE, length - first)
        for i in range(count):
            k = first + i
            for j in range(N_ROWS):
                x[2 * j] = positions[k, j]
                x[2 * j + 1] = velocities[k, j]
            sampled_parts(x, inputs[k], constants, parts)
            for a in range(n_wanted):
                after[a, i + 2] = parts[wanted[a]]
            if zero_order:
                if k > 0:
                    sampled_parts(x, inputs[k - 1], constants, parts)
                for a in range(n_wanted):
                    until[a, i + 2] = parts[wanted[a]]
        begin = max(2 - first, 0)  # the first two samples of all have no second difference
        for j in range(N_ROWS):
            for i in range(begin, count):
                k = first + i
                step = positions[k, j] - positions[k - 1, j]
                step_before = positions[k - 1, j] - positions[k - 2, j]
                slope[j, i] = 0.5 * rate * (positions[k, j] - positions[k - 2, j])
                curvature[j, i] = rate * rate * (step - step_before)
        for a in range(n_wanted):
            w0, w1, w2, w3 = weights[0, a], weights[1, a], weights[2, a], weights[3, a]
            for i in range(begin, count):
                value[i] = w0 * after[a, i] + w1 * until[a, i + 1]
                value[i] += w2 * after[a, i + 1] + w3 * until[a, i + 2]
            for j in range(N_ROWS):
                f, d = factors[j, a], acceleration[j, a]
                if f != 0.0 or d != 0.0:
                    for i in range(begin, count):
                        value[i] += f * slope[j, i] + d * curvature[j, i]
            smooth, smoother = once[a], twice[a]
            row = wanted[a]
            for i in range(begin, count):
                smooth = pole * smooth + gain * value[i]
                smoother = pole * smoother + gain * smooth
                filtered[row, at + first + i - 2] = smoother
            once[a], twice[a] = smooth, smoother
            for i in range(2):
                after[a, i] = after[a, count + i]
                if zero_order:
                    until[a, i] = until[a, count + i]
