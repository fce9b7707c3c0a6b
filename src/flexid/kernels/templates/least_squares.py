"""Recursive least squares with a covariance from the scores of blocks; for all models."""

from itertools import pairwise
from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.kernels.templates.least_squares_rows import *
    from flexid.kernels.templates.status import *


N_BLOCKS = 40  # largest number of blocks kept for the standard deviations
N_COUNTS = 6
# Indices in the counts; `store_block` uses the first three.
BLOCKS, CLOCK, BLOCK_LENGTH, SPAN, AGE, PAST_GONE = range(N_COUNTS)

RIDGE = 1e-9  # of the matrix scaled to a unit diagonal: less is lost in rounding
LEAST_TOLERANCE = 1e-5  # smallest part of a regressor that others do not explain
LEAST_INFORMATION = 1e-4  # fraction of a coefficient's largest information, never forgotten
LEAST_EXPLAINED = 0.5  # smallest explained part of a left-hand side; of noise it is a hundredth
LEAST_PIVOT = 1e-12  # fraction of a diagonal: smaller pivots after elimination are rounding errors


def sizes(address, starts, n_inputs, n_constants, half):
    """Return sizes of a model, its rows' coefficients from `starts` on, and its state's layout.

    A state contains the estimates, the counts, the power of each row's left-hand side and the
    filter's past; then normal equations, a matrix per row and then a vector per row, of all
    samples, of the current block and of the blocks before; last the data that make the rows.
    """
    n_rows, n_coefficients = len(starts) - 1, starts[-1]
    n_signals = n_coefficients + n_rows
    width = max(stop - start for start, stop in pairwise(starts)) + N_PAST
    size = n_rows * (width * width + width)
    memory = 1 + (2 * half + 3) * (n_rows + n_inputs) + 5 * n_signals
    parts = (n_coefficients, N_COUNTS, n_rows, n_rows * N_PAST, n_coefficients, size, size)
    parts += (N_BLOCKS, N_BLOCKS, N_BLOCKS * size, memory)
    places = [sum(parts[: i + 1]) for i in range(len(parts))]
    return Sizes(address, n_rows, n_inputs, n_coefficients, n_constants, width, *places)


@rounded
def scaled_factor(matrix, n, width, scale, factor):
    """Cholesky factor of the matrix scaled to a unit diagonal, plus the ridge."""
    for i in range(n):
        square = matrix[i * width + i]
        scale[i] = 1.0 / sqrt(square) if square > 0.0 else 0.0
    for i in range(n):
        for j in range(i + 1):
            total = scale[i] * matrix[i * width + j] * scale[j]
            if i == j:
                total = 1.0 + RIDGE
            for k in range(j):
                total -= factor[i * width + k] * factor[j * width + k]
            # Only rounding errors can make the rest smaller than the ridge.
            root = i == j
            factor[i * width + j] = (
                sqrt(max(total, RIDGE)) if root else total / factor[j * width + j]
            )


@rounded
def least_tolerance(factor, n, wanted, width, work):
    """Smallest of the first `wanted` entries of one over the diagonal of the inverse.

    For a unit diagonal an entry is the part of a regressor's square that others do not explain.
    """
    least = 1.0
    for i in range(wanted):
        square = 0.0
        for j in range(i, n):
            total = 1.0 if j == i else 0.0
            for k in range(i, j):
                total -= factor[j * width + k] * work[k]
            work[j] = total / factor[j * width + j]
            square += work[j] * work[j]
        least = min(least, 1.0 / square)
    return least


@rounded
def forget_unknown(matrix, vector, i, width):
    """Set all entries of one unknown in the normal equations to zero."""
    vector[i] = 0.0
    for j in range(width):
        matrix[i * width + j] = 0.0
        matrix[j * width + i] = 0.0


@rounded
def eliminate_past(matrix, vector, n, width, least):
    """Eliminate the unknown past from the normal equations; return the square that it explained."""
    explained = 0.0
    for i in range(n):
        least[i] = LEAST_PIVOT * matrix[i * width + i]
    for q in range(n + N_PAST - 1, n - 1, -1):
        pivot = matrix[q * width + q]
        if pivot > LEAST_PIVOT * matrix[n * width + n]:
            explained += vector[q] * vector[q] / pivot
            for i in range(q):
                share = matrix[i * width + q] / pivot
                vector[i] -= share * vector[q]
                for j in range(q):
                    matrix[i * width + j] -= share * matrix[q * width + j]
        forget_unknown(matrix, vector, q, width)
    for i in range(n):
        if not matrix[i * width + i] > least[i]:  # the past explains all of it
            forget_unknown(matrix, vector, i, width)
    return explained


@rounded
def places(first, j, model):
    """Indices of the matrix and the vector of row j in normal equations that start at `first`."""
    width = model.width
    return first + j * width * width, first + (model.n_rows * width + j) * width


@rounded
def forget_past(state, model, starts, work):
    """Eliminate the unknown past of all rows, once it has decayed or a new recording begins."""
    width = model.width
    for j in range(model.n_rows):
        n = starts[j + 1] - starts[j]
        for first in (model.equations, model.own):
            matrix_at, vector_at = places(first, j, model)
            matrix = part(state, matrix_at, width * width)
            explained = eliminate_past(matrix, part(state, vector_at, width), n, width, work)
            if first == model.equations:
                state[model.power + j] -= explained
    for i in range(model.past, model.peaks):
        state[i] = 0.0
    state[model.counts + PAST_GONE] = 1.0


@rounded
def store_block(counts, ends, lengths, blocks, block, length, forgetting, longest):
    """Store the normal equations of one more block, after merging old blocks if there is no room.

    counts      blocks kept, samples so far, wanted length of a block in samples
    ends        count of samples at the end of each block
    lengths     samples in each block
    blocks      normal equations of all blocks, block after block
    block       normal equations of the new block, which has the given length
    forgetting  factor on weights per sample
    longest     largest length of a block
    """
    kept, size = int(counts[0]), block.shape[0]
    if kept == ends.shape[0]:
        if 2.0 * counts[2] <= longest:  # merge all in pairs; new blocks are twice as long
            counts[2] *= 2.0
            pairs = kept // 2
        else:  # merge the two oldest blocks, which have little weight left
            pairs = 1
        for b in range(kept - pairs):
            fading = 0.0
            first = b + pairs
            if b < pairs:
                first = 2 * b + 1
                fading = forgetting ** (ends[first] - ends[first - 1])
            for i in range(size):
                merged = fading * blocks[(first - 1) * size + i] if b < pairs else 0.0
                blocks[b * size + i] = merged + blocks[first * size + i]
            lengths[b] = lengths[first] + (lengths[first - 1] if b < pairs else 0.0)
            ends[b] = ends[first]
        kept -= pairs
    for i in range(size):
        blocks[kept * size + i] = block[i]
    ends[kept] = counts[1]
    lengths[kept] = length
    counts[0] = kept + 1.0


@rounded
def close_block(state, settings, model):
    """Store the current block for the covariance and begin another."""
    counts = part(state, model.counts, N_COUNTS)
    size = model.ends - model.own
    own = part(state, model.own, size)
    store_block(
        counts,
        part(state, model.ends, N_BLOCKS),
        part(state, model.lengths, N_BLOCKS),
        part(state, model.stored, N_BLOCKS * size),
        own,
        counts[SPAN],
        settings[FORGETTING],
        settings[LONGEST_BLOCK],
    )
    counts[SPAN] = 0.0
    for i in range(size):
        own[i] = 0.0


@rounded
def break_off(state, settings, model, starts, work):
    """End a recording at a missing sample; the estimates stay unchanged."""
    counts = part(state, model.counts, N_COUNTS)
    if counts[SPAN] > 0.0:
        if counts[PAST_GONE] == 0.0:
            forget_past(state, model, starts, work)
        close_block(state, settings, model)
    counts[AGE] = 0.0
    counts[PAST_GONE] = 0.0
    for i in range(model.rows, state.shape[0]):
        state[i] = 0.0


@rounded
def accumulate(matrix, vector, fading, m, width, regressor, target):
    """Multiply normal equations by the fading factor, and add one equation to them."""
    for i in range(m):
        for k in range(m):
            product = regressor[i] * regressor[k]
            matrix[i * width + k] = fading * matrix[i * width + k] + product
        vector[i] = fading * vector[i] + regressor[i] * target


@rounded
def solve(matrix, vector, m, width, unknowns, room):
    """Update the unknowns to solve the normal equations, up to the ridge."""
    scale, step, factor = room
    scaled_factor(matrix, m, width, scale, factor)
    # The ridge fixes undetermined directions; the others are exact after a few samples.
    for i in range(m):
        total = vector[i]
        for k in range(m):
            total -= matrix[i * width + k] * unknowns[k]
        total *= scale[i]
        for k in range(i):
            total -= factor[i * width + k] * step[k]
        step[i] = total / factor[i * width + i]
    for i in range(m - 1, -1, -1):
        total = step[i]
        for k in range(i + 1, m):
            total -= factor[k * width + i] * step[k]
        step[i] = total / factor[i * width + i]
        unknowns[i] += scale[i] * step[i]


@rounded
def update_row(j, start, n, m, state, settings, target, model, room):
    """Add one row's equation; return the innovation and whether its coefficients are determined."""
    regressor, unknowns, scale, step, factor = room
    width, fading = model.width, settings[FORGETTING]
    matrix_at, vector_at = places(model.equations, j, model)
    matrix, vector = part(state, matrix_at, width * width), part(state, vector_at, width)
    innovation = target
    for i in range(m):
        past_at = model.past + N_PAST * j + i - n
        unknowns[i] = state[start + i] if i < n else state[past_at]
        innovation -= regressor[i] * unknowns[i]
    accumulate(matrix, vector, fading, m, width, regressor, target)
    matrix_at, vector_at = places(model.own, j, model)
    own_matrix, own_vector = part(state, matrix_at, width * width), part(state, vector_at, width)
    accumulate(own_matrix, own_vector, fading, m, width, regressor, target)
    for i in range(n):  # information that is never forgotten, centred on the estimate
        peak = max(state[model.peaks + start + i], matrix[i * width + i])
        state[model.peaks + start + i] = peak
        kept = (1.0 - fading) * LEAST_INFORMATION * peak
        matrix[i * width + i] += kept
        vector[i] += kept * unknowns[i]
    solve(matrix, vector, m, width, unknowns, (scale, step, factor))
    power = fading * state[model.power + j] + target * target
    state[model.power + j] = power
    for i in range(m):
        past_at = model.past + N_PAST * j + i - n
        state[start + i if i < n else past_at] = unknowns[i]
    explained = 0.0
    for i in range(m):
        total = 2.0 * vector[i]
        for k in range(m):
            total -= matrix[i * width + k] * unknowns[k]
        explained += unknowns[i] * total
    determined = explained > LEAST_EXPLAINED * power
    determined = determined and least_tolerance(factor, m, n, width, step) > LEAST_TOLERANCE
    for i in range(n):
        determined = determined and scale[i] > 0.0
    return innovation, determined


@rounded
def take(state, sample, settings, info, model, starts, room):
    """Process one sample: update the state in place, write innovations and a status to info."""
    for_rows, for_law = room
    regressor, work = for_law[0], for_law[1]
    signals = for_rows[3]
    counts = part(state, model.counts, N_COUNTS)
    memory = part(state, model.rows, state.shape[0] - model.rows)
    for j in range(model.n_rows):
        info[j] = np.nan
    if not is_finite(sample):
        break_off(state, settings, model, starts, work)
        info[model.n_rows] = REJECTED
        return
    info[model.n_rows] = STARTING
    if not next_row(memory, sample, settings, model, for_rows):
        return
    if counts[PAST_GONE] == 0.0 and counts[AGE] >= settings[MEMORY]:
        forget_past(state, model, starts, work)
        if counts[SPAN] > 0.0:
            close_block(state, settings, model)
    elif counts[PAST_GONE] != 0.0 and counts[SPAN] >= counts[BLOCK_LENGTH]:
        close_block(state, settings, model)
    n_past = N_PAST if counts[PAST_GONE] == 0.0 else 0
    all_determined = counts[CLOCK] >= settings[FEWEST]
    for j in range(model.n_rows):
        start = starts[j]
        n = starts[j + 1] - start
        for i in range(n):
            regressor[i] = signals[start + i]
        if n_past > 0:
            past(memory, settings, regressor, n)
        target = signals[model.n_coefficients + j]
        info[j], determined = update_row(
            j, start, n, n + n_past, state, settings, target, model, for_law
        )
        all_determined = all_determined and determined
    counts[AGE] += 1.0
    counts[SPAN] += 1.0
    counts[CLOCK] += 1.0
    if all_determined:
        info[model.n_rows] = USED


@njit(**allocating)
def room_for_samples(model):
    """Work arrays: a state and signals for the rows, vectors and a factor for the update."""
    count, width = model.n_coefficients + model.n_rows, model.width
    signals = np.empty(count), np.empty(count), np.empty(count)
    vectors = np.empty(width), np.empty(width), np.empty(width), np.empty(width)
    return (np.empty(2 * model.n_rows),) + signals, vectors + (np.empty(width * width),)


@njit(**equations)
def step(state, sample, settings, layout, starts):
    """Return the new state and info after one sample; the old state is unchanged."""
    model = Sizes(*layout)
    new = state.copy()
    info = np.empty(model.n_rows + 1)
    take(new, sample, settings, info, model, starts, room_for_samples(model))
    return new, info


@njit(**equations, nogil=True)
def replay(state, samples, settings, layout, starts, coefficients, infos):
    """Step over all samples; fill the history and return the last state."""
    model = Sizes(*layout)
    room = room_for_samples(model)
    current = state.copy()
    for n in range(samples.shape[0]):
        take(current, samples[n], settings, infos[n], model, starts, room)
        for i in range(model.n_coefficients):
            coefficients[n, i] = current[i]
    return current
