"""Motion over segments with its derivatives, and the normal equations of its residuals."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.kernels.templates.dry_motion import *
    from flexid.kernels.templates.run_status import *


AT_MOST = 1.5  # of a direction, which the low-pass may bring beyond 1; more says that a row rests


@njit(**equations)
def linearise(states, inputs, coefficients, constants, address, found):
    """Derivatives of the rates of velocities and memories by the states, about each state."""
    model = Model(*address)
    columns = np.zeros(AT + model.n_coefficients, np.int64)
    work = np.zeros(model.work_size)
    put(constants, model.constants, work)
    for s in range(states.shape[0]):
        put(states[s], model.x, work)
        put(coefficients[s], model.coefficients, work)
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
    """Velocity of what an output measures, as far as it may be late; see `segment_equations`."""
    speed = work[model.x + state + 1]
    if reference >= 0:
        speed -= work[model.x + reference + 1]
    elif reference < -1:
        following = model.drive + 4 * (-1 - reference)  # the input after it, which is its velocity
        speed -= work[following]
    return speed


@uncounted
def add_residuals(errors, rows, whitening, mixed, normal, gradient):
    """Add a sample's residuals to the lower half of a block's normal equations; their cost."""
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


@uncounted
def correct(errors, rows, gains, model, work, columns):
    """Correct a predicted state and the disturbances by what was measured, as an observer does."""
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


@uncounted
def set_drive(drive, model, work):
    """Let the inputs be those over one interval."""
    for j in range(model.n_inputs):
        for i in range(4):
            work[model.drive + 4 * j + i] = drive[j, i]


@uncounted
def put(values, place, work):
    """Copy numbers into `work`, or another array."""
    for i in range(values.shape[0]):
        work[place + i] = values[i]


@uncounted
def start_segment(start, coefficients, model, work):
    """Begin at a state, with the derivatives that it has by itself."""
    put(start, model.x, work)
    put(coefficients, model.coefficients, work)
    for row in range(model.n_rows):
        work[model.disturbance + row] = 0.0
    start_derivatives(model, work)


@uncounted
def set_modes(dry, directed, trace, h, model, work, columns):
    """Mode of each row; none sticks where an observer directs friction."""
    columns[ARE_DRY] = 0
    for row in range(model.n_rows):
        sticks = dry[row] and not directed
        work[model.dry + row] = 1.0 if sticks else 0.0
        columns[ARE_DRY] |= sticks
    first_modes(h, trace, model, work, columns)


@uncounted
def set_directions(directions, model, work):
    """Modes over an interval, as an observer knows them; a row that rests follows its sensor."""
    for row in range(model.n_rows):
        rests = directions[row] > AT_MOST
        work[model.dry + row] = 1.0 if rests else 0.0
        work[model.modes + row] = 0.0 if rests else directions[row]


@uncounted
def omit_resting(errors, rows, model, work):
    """Nothing is learnt from the position of a row that rests: its friction may be any."""
    for a in range(errors.shape[0]):
        if work[model.dry + a] != 0.0:
            errors[a] = 0.0
            clear(0, rows.shape[1], rows[a])


@uncounted
def follow_sensors(outputs, speeds, late_columns, k, last, h, model, work):
    """Let a row that rests be where it was measured, at the velocity that was measured."""
    before, after = k - 1, min(k + 1, last)
    span = (after - before) * h
    for a in range(outputs.shape[1]):
        state = 2 * a
        if work[model.dry + a] != 0.0:
            work[model.x + state] = outputs[k, a]
            work[model.x + state + 1] = (outputs[after, a] - outputs[before, a]) / span
            position = model.z + state * model.width
            clear(position, 2 * model.width, work)
            if late_columns[a] >= 0:  # where it was measured depends on how late that was
                column = position + 1 + late_columns[a]
                work[column] = speeds[k, a]
                work[column + model.width] = (speeds[after, a] - speeds[before, a]) / span


@uncounted
def fill_rows(rows, model, work, columns):
    """What each output is by the model, and its derivatives."""
    for a in range(rows.shape[0]):
        row, state = rows[a], 2 * a
        clear(0, row.shape[0], row)
        row[0] = work[model.x + state]
        for j in range(1, columns[IN_USE]):
            row[j] = work[model.z + state * model.width + j]


@njit(**equations, nogil=True)
def segment_equations(part, segments, sensors, motion, substeps, trace, columns, results, address):
    """Normal equations of every block for its segment's initial state and what is sought.

    part      the first segment, and the one that is no longer taken: threads that have different
              ones do not meet
    segments  first sample, number of samples, first block and sample time of each, and its initial
              state; segment s is made up of the blocks first_blocks[s] to first_blocks[s + 1] - 1,
              all of about the same length
    sensors   outputs as they were on time, shape (n, n_rows), and of each column a, which is the
              position of row a, less the state reference[a], if that is not -1, or less the input
              -2 - reference[a], if that is below, of which the next input is the velocity, as far
              as delays go; the place of its delay among what is sought (-1: not sought), for each
              segment the lower triangle that whitens the outputs' noise, and, where an observer
              follows the outputs, their rates: a bare motion has the model's, without noise
    motion    drives[k], of each input over the interval from sample k on its start and its change,
              and the derivatives of both by the delay; coefficients of each segment; constants;
              which rows can stick; and the observer: for each segment the gains of the states and
              of the disturbances, one column for each output, or none, and what an interval leaves
              of a disturbance; the direction of each row's friction over the interval from
              each sample on, or more than `AT_MOST` of a row that rests, or none where it follows
              from the motion; and after how many samples of a segment the model runs alone
    trace     of each row the standard deviation of its position's noise
    columns   which columns of derivatives are in use, for what; see the template ``model``
    results   filled, all zero before: lower halves of normal equations, shape (n_blocks, n, n),
              their right-hand sides, shape (n_blocks, n), residuals, shape of the outputs, and the
              weighted sum of squares of each segment: infinite, and then the last one, if its
              motion diverged. If n is 0, the motion runs without derivatives
    address   of the model, and what lies where in its work: `Model`
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
        start_segment(initial_states[s], p[s], model, work)
        directed = observed and directions.shape[0] > 0
        set_modes(dry, directed, trace, h, model, work, columns)
        for k in range(first, first + lengths[s]):
            alone = k - first >= corrected[s]
            if k > first:  # the inputs are still those from the sample before on
                if directed and alone:
                    directed = not alone  # a literal would be compiled for itself
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
