"""Rows of the regression, sample by sample, from filtered positions.

Signals of a model are its regressors, row by row, and then the known part of each row. A function
of the model computes them from a state and inputs, without the terms that are linear in velocities;
the factors of these terms are in the settings. All models share this kernel, which calls the
model's function by its address.
"""

from collections import namedtuple
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *

# Indices in the settings: of the update, then of the rows. Half a window is the number of samples
# on either side that an estimated velocity uses, or 0 without velocities. Then come constants, the
# factor of each row's velocity in each signal, and whether each signal depends on an input.
FORGETTING, LONGEST_BLOCK, MEMORY, FEWEST = range(4)
SAMPLE_TIME, ZERO_ORDER, POLE, HALF_WINDOW, CONSTANTS = range(4, 9)

N_PAST = 2  # number of sequences that make up the filter's response to its initial state

# A model: the address of its signals, its sizes, and the layout of the state; see `sizes`.
Sizes = namedtuple(
    "Sizes",
    "address n_rows n_inputs n_coefficients n_constants width "
    "counts power past peaks equations own ends lengths stored rows state",
)


@rounded
def past(memory, settings, regressor, first):
    """Fill in the filter's responses to its initial state at the latest row i: z^i and i z^i."""
    rows = memory[0] - (2.0 * settings[HALF_WINDOW] + 3.0)
    decayed = settings[POLE] ** rows
    regressor[first] = decayed
    regressor[first + 1] = rows * decayed


@rounded
def middle_of_window(memory, settings, model, x):
    """Set x to positions in the middle of the window, and slopes of straight lines around them."""
    h, half = settings[SAMPLE_TIME], int(settings[HALF_WINDOW])
    size = model.n_rows + model.n_inputs
    middle = 1 + (half + 2) * size
    for j in range(model.n_rows):
        x[2 * j] = memory[middle + j]
        x[2 * j + 1] = 0.0
        if half > 0:
            slope = 0.0
            for i in range(1, half + 1):
                slope += i * (memory[middle + i * size + j] - memory[middle - i * size + j])
            x[2 * j + 1] = 3.0 * slope / (h * half * (half + 1) * (2 * half + 1))
    return middle


@rounded
def next_row(memory, sample, settings, model, room):
    """Process one sample; return whether there is a row: regressors, then left-hand sides.

    Rows equal those of `filtered_least_squares`. Positions and inputs lag by half a window, because
    velocities are slopes around them.
    """
    memory[0] += 1.0
    x, now, end_now, signals = room
    n_rows, size = model.n_rows, model.n_rows + model.n_inputs
    n_signals = model.n_coefficients + n_rows
    zero_order, pole = settings[ZERO_ORDER] != 0.0, settings[POLE]
    half = int(settings[HALF_WINDOW])
    width = 2 * half + 3  # number of samples kept: a second difference at the middle sample
    for i in range(1, 1 + (width - 1) * size):
        memory[i] = memory[i + size]
    for j in range(size):
        memory[1 + (width - 1) * size + j] = sample[j]
    count = memory[0]
    if count < 2 * half + 1:
        return False
    middle = middle_of_window(memory, settings, model, x)
    constants = part(settings, CONSTANTS, model.n_constants)
    inputs = part(memory, middle + n_rows, model.n_inputs)
    call(model.address, x, inputs, constants, now)
    if zero_order and count > 2 * half + 1:
        inputs = part(memory, middle - size + n_rows, model.n_inputs)
        call(model.address, x, inputs, constants, end_now)
    else:
        for i in range(n_signals):
            end_now[i] = now[i]
    kept = 1 + width * size
    before = part(memory, kept, n_signals)
    long_before = part(memory, kept + n_signals, n_signals)
    end_before = part(memory, kept + 2 * n_signals, n_signals)
    once = part(memory, kept + 3 * n_signals, n_signals)
    twice = part(memory, kept + 4 * n_signals, n_signals)
    if count >= width:
        rate = 1.0 / settings[SAMPLE_TIME]
        factors = CONSTANTS + model.n_constants
        held = factors + n_signals * n_rows
        for i in range(n_signals):
            if settings[held + i] != 0.0:
                inner = end_before[i] + before[i]
                value = (1.0 / 6.0) * (long_before[i] + 2.0 * inner + end_now[i])
            else:
                value = (1.0 / 12.0) * (long_before[i] + 10.0 * before[i] + now[i])
            for j in range(n_rows):
                factor = settings[factors + i * n_rows + j]
                difference = memory[middle + j] - memory[middle - 2 * size + j]
                value += factor * (0.5 * rate * difference)
            if i >= model.n_coefficients:
                at = middle + i - model.n_coefficients
                change = memory[at] - memory[at - size]
                change_before = memory[at - size] - memory[at - 2 * size]
                value = rate * rate * (change - change_before) - value
            once[i] = pole * once[i] + (1.0 - pole) * value
            twice[i] = pole * twice[i] + (1.0 - pole) * once[i]
            signals[i] = twice[i]
    for i in range(n_signals):
        long_before[i] = before[i]
        before[i] = now[i]
        end_before[i] = end_now[i]
    return count >= width
