"""Motion over segments with its derivatives, and the normal equations of the residuals."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.kernels.templates.dry_motion import *
    from flexid.kernels.templates.run_status import *


AT_MOST = 1.5  # largest direction: a low-pass may overshoot 1; larger values mark a resting row


@njit(**equations)
def linearise(states, inputs, coefficients, constants, address, found):
    """Compute the derivatives, by the states, of the rates of velocities and memories."""
    model = Model(*address)
    columns = np.zeros(AT + model.n_coefficients, np.int64)
    work = np.zeros(model.work_size)
    put(constants, model.constants, work)
    for s in range(states.shape[0]):
        put(states[s], model.x, work)
        set_coefficients(coefficients[s], model, work, columns)
        for row in range(model.n_rows):
            velocity = work[model.x + 2 * row + 1]
            work[model.modes + row] = np.sign(velocity)
        for j in range(model.n_inputs):
            work[model.drive + 4 * j] = inputs[s, j]
        call(model.address, work, columns, 0.0, 0.0, 0.0, model.x, model.x, LINEARISE)
        for i in range(found.shape[1]):
            found[s, i] = work[model.by_state + i]


@inlined
def speed_of(state, reference, model, work):
    """Velocity of the delayed part of an output; see `segment_equations`."""
    speed = work[model.x + state + 1]
    if reference >= 0:
        speed -= work[model.x + reference + 1]
    elif reference < -1:
        following = model.drive + 4 * (-1 - reference)  # the next input, which is the velocity
        speed -= work[following]
    return speed


@inlined
def add_residuals(errors, rows, whitening, mixed, normal, gradient):
    """Add a sample to the lower half of a block's normal equations; return its cost."""
    cost = 0.0
    for b in range(errors.shape[0]):
        clear(0, mixed.shape[0], mixed)
        residual = 0.0
        for a in range(b + 1):
            weight = whitening[b, a]
            if weight != 0.0:
                residual += weight * errors[a]
                for j in range(gradient.shape[0]):
                    mixed[j] += weight * rows[a, 1 + j]
        for j in range(gradient.shape[0]):
            gradient[j] += mixed[j] * residual
            for i in range(j + 1):
                normal[j, i] += mixed[j] * mixed[i]
        cost += residual * residual
    return cost


@inlined
def correct(errors, rows, gains, model, work, columns):
    """Correct a predicted state and the disturbances by an observer's gains times the errors."""
    gain, disturbance_gain, decay = gains
    x, z, width, n = model.x, model.z, model.width, columns[IN_USE]
    for row in range(model.n_rows):
        disturbance, disturbed = model.disturbance + row, model.disturbed + row * width
        work[disturbance] *= decay[row]
        for j in range(1, n):
            work[disturbed + j] *= decay[row]
        for a in range(errors.shape[0]):
            work[disturbance] += disturbance_gain[row, a] * errors[a]
            for j in range(1, n):
                work[disturbed + j] -= disturbance_gain[row, a] * rows[a, j]
    for i in range(2 * model.n_rows):
        for a in range(errors.shape[0]):
            work[x + i] += gain[i, a] * errors[a]
            for j in range(1, n):
                work[z + i * width + j] -= gain[i, a] * rows[a, j]
    for row in range(model.n_rows):
        if work[model.dry + row] != 0.0 and work[model.modes + row] == 0.0:
            work[x + 2 * row + 1] = 0.0
            clear(z + (2 * row + 1) * width, n, work)


@inlined
def set_drive(drive, model, work):
    """Set the inputs over one interval."""
    for j in range(model.n_inputs):
        put(drive[j], model.drive + 4 * j, work)


@uncounted
def put(values, place, work):
    """Copy numbers into `work`, or into another array."""
    for i in range(values.shape[0]):
        work[place + i] = values[i]


@uncounted
def set_coefficients(coefficients, model, work, columns):
    """Set the coefficients, and thereby the terms that act."""
    put(coefficients, model.coefficients, work)
    call(model.address, work, columns, 0.0, 0.0, 0.0, model.x, model.x, FIND_ACTING)


@uncounted
def start_segment(start, coefficients, model, work, columns):
    """Start at a state, with unit derivatives by the state itself."""
    put(start, model.x, work)
    set_coefficients(coefficients, model, work, columns)
    for row in range(model.n_rows):
        work[model.disturbance + row] = 0.0
    width = model.width
    clear(model.z, model.n_states * width, work)
    clear(model.disturbed, model.n_rows * width, work)
    for i in range(model.n_states):
        work[model.z + i * width + 1 + i] = 1.0


@uncounted
def set_modes(dry, directed, trace, h, model, work, columns):
    """Set the mode of each row; no row sticks if an observer directs friction."""
    columns[ARE_DRY] = 0
    for row in range(model.n_rows):
        sticks = dry[row] and not directed
        work[model.dry + row] = 1.0 if sticks else 0.0
        columns[ARE_DRY] |= sticks
    first_modes(h, trace, model, work, columns)


@uncounted
def set_directions(directions, model, work):
    """Set the modes over an interval to an observer's directions; a resting row has mode 0."""
    for row in range(model.n_rows):
        rests = directions[row] > AT_MOST
        work[model.dry + row] = 1.0 if rests else 0.0
        work[model.modes + row] = 0.0 if rests else directions[row]


@uncounted
def omit_resting(errors, rows, model, work):
    """Ignore the position of a resting row, whose friction is unknown."""
    for a in range(errors.shape[0]):
        if work[model.dry + a] != 0.0:
            errors[a] = 0.0
            clear(0, rows.shape[1], rows[a])


@uncounted
def follow_sensors(outputs, speeds, late_columns, k, last, h, model, work):
    """Set a resting row to the measured position and velocity."""
    before, after = k - 1, min(k + 1, last)
    span = (after - before) * h
    for a in range(outputs.shape[1]):
        state = 2 * a
        if work[model.dry + a] != 0.0:
            work[model.x + state] = outputs[k, a]
            work[model.x + state + 1] = (outputs[after, a] - outputs[before, a]) / span
            position = model.z + state * model.width
            clear(position, 2 * model.width, work)
            if late_columns[a] >= 0:  # the measured position depends on the delay
                column = position + 1 + late_columns[a]
                work[column] = speeds[k, a]
                work[column + model.width] = (speeds[after, a] - speeds[before, a]) / span


@inlined
def fill_rows(rows, model, work, columns):
    """Fill in each output of the model and its derivatives."""
    for a in range(rows.shape[0]):
        row, state = rows[a], 2 * a
        clear(0, row.shape[0], row)
        row[0] = work[model.x + state]
        for j in range(1, columns[IN_USE]):
            row[j] = work[model.z + state * model.width + j]


@njit(**equations, nogil=True)
def segment_equations(part, segments, sensors, motion, substeps, trace, columns, results, address):
    """Assemble each block's normal equations for the initial state and the unknowns.

    part      first segment, and the end of the range of segments; threads have disjoint ranges
    segments  first sample, number of samples, first block, sample time and initial state of each
              segment. Segment s consists of the blocks first_blocks[s] to first_blocks[s + 1] - 1,
              all of about the same length
    sensors   outputs without delays, shape (n, n_rows): column a is the position of row a;
              reference of each output, for its delay: -1 without a reference, else the index of a
              state, or, below -1, the input -2 - reference[a], and the next input is its velocity;
              index of each output's delay among the unknowns, or -1 if the delay is known; lower
              triangle of each segment that whitens the outputs' noise; rates of the outputs, used
              if an observer follows the outputs. Without an observer the model gives the rates,
              free of noise
    motion    drives[k]: start and change of each input over the interval after sample k, and the
              derivatives of both by the delay; coefficients of each segment; constants; mask of the
              rows that can stick; and the observer: gains of the states and of the disturbances for
              each segment, one column per output, or no columns; factor on a disturbance per
              interval; direction of each row's friction over the interval after each sample, or
              more than `AT_MOST` for a resting row, or no directions if they follow from the
              motion; number of samples of a segment after which the model runs freely
    trace     standard deviation of the noise of each row's position
    columns   columns of derivatives in use; see the template ``model``
    results   arrays to fill, all zero before: lower halves of normal equations, (n_blocks, n, n),
              right-hand sides, (n_blocks, n), residuals, shape of the outputs, and the weighted sum
              of squares of each segment. It is infinite if the motion diverged, and the range ends
              there. If n is 0, the motion runs without derivatives
    address   address of the model and layout of its work: `Model`
    """
    starts, lengths, first_blocks, sample_times, initial_states = segments
    outputs, reference, late_columns, whitening, speeds = sensors
    drives, p, c, dry, observer = motion
    gain, disturbance_gain, decay, directions, corrected = observer
    normal, gradient, residuals, costs = results
    model = Model(*address)
    observed = gain.shape[2] > 0
    size, count = normal.shape[1], outputs.shape[1]
    work = np.zeros(model.work_size)
    put(c, model.constants, work)
    errors, rows, mixed = np.zeros(count), np.zeros((count, 1 + size)), np.zeros(size)
    for s in range(part[0], part[1]):
        h, first, b = sample_times[s], starts[s], first_blocks[s]
        blocks = first_blocks[s + 1] - b
        costs[s] = 0.0
        set_drive(drives[first], model, work)
        start_segment(initial_states[s], p[s], model, work, columns)
        directed = observed and directions.shape[0] > 0
        set_modes(dry, directed, trace, h, model, work, columns)
        for k in range(first, first + lengths[s]):
            alone = k - first >= corrected[s]
            if k > first:  # the inputs are still set to the interval before
                if directed and alone:
                    directed = not alone  # a literal False would be compiled separately
                    set_modes(dry, directed, trace, h, model, work, columns)
                if directed:
                    set_directions(directions[k - 1], model, work)
                cross_interval(h, substeps, model, work, columns)
            set_drive(drives[k], model, work)
            fill_rows(rows, model, work, columns)
            for a in range(count):
                if late_columns[a] >= 0:
                    speed = speeds[k, a] if observed else speed_of(2 * a, reference[a], model, work)
                    rows[a, 1 + late_columns[a]] -= speed
                errors[a] = outputs[k, a] - rows[a, 0]
                if not abs(errors[a]) < BOUND:
                    costs[s] = np.inf
                    return
            if directed and k > first:
                omit_resting(errors, rows, model, work)
            put(errors, 0, residuals[k])
            b = first_blocks[s] + (k - first) * blocks // lengths[s]
            costs[s] += add_residuals(errors, rows, whitening[s], mixed, normal[b], gradient[b])
            if observed:
                if alone:
                    clear(0, count, errors)
                gains = gain[s], disturbance_gain[s], decay[s]
                correct(errors, rows, gains, model, work, columns)
                if directed and k > first:
                    last = first + lengths[s] - 1
                    follow_sensors(outputs, speeds, late_columns, k, last, h, model, work)
