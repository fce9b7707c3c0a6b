"""Motion over segments with its derivatives, and the normal equations of its residuals."""

from collections import namedtuple
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.bound import BOUND
    from flexid.kernels.templates.dry_motion import (
        Motion,
        cross_interval,
        first_modes,
        rates_at,
        room_for_derivatives,
        slopes_at,
        start_derivatives,
    )
    from flexid.kernels.templates.generated import (
        N_COEFFICIENTS,
        N_CORNERS,
        N_INPUTS,
        N_ROWS,
        N_STATES,
        WIDTH,
        inlined,
        uncounted,
    )
    from flexid.kernels.templates.runge_kutta import room_for_a_step


@njit(cache=True, error_model="numpy")
def position_noise(measured, whitening):
    """Standard deviation of each row's position; 0 where it is not measured."""
    noise = np.zeros(N_ROWS)
    for a in range(measured.shape[0]):
        if measured[a] % 2 == 0:
            noise[measured[a] // 2] = 1.0 / whitening[0, a, a]
    return noise


@inlined
def add_delay(row, x, rate, derivatives, drive, h, sensor):
    """Move what an output should be, and its derivatives, to when the output is true.

    rate      of x, and `derivatives` of which the first stage is at it, too
    sensor    the state that it measures; the state that it is relative to, if that is not -1, or
              the input -2 - that, if it is below; the delay in s, and its place among what is
              sought
    """
    state, reference, late, late_column = sensor
    z, n, by_state, by_rest, _, _, _ = derivatives
    speed, acceleration = x[state + 1], rate[state + 1]
    if reference >= 0:
        speed -= x[reference + 1]
        acceleration -= rate[reference + 1]
    elif reference < -1:
        i = -1 - reference  # the input after it, which is its velocity
        speed -= drive[i, 0]
        acceleration -= drive[i, 1] / h
    row[0] += late * (0.5 * late * acceleration - speed)
    if late_column >= 0:
        row[1 + late_column] = late * acceleration - speed
    for sign, place in ((1.0, state), (-1.0, reference)):
        if place < 0:
            continue
        own = place // 2 * WIDTH
        for j in range(1, n):
            change = by_rest[own + j]
            for i in range(N_STATES):
                change += by_state[0, place // 2, i] * z[i * WIDTH + j]
            speed = z[(place + 1) * WIDTH + j]
            row[j] += sign * late * (0.5 * late * change - speed)


@inlined
def add_residuals(errors, rows, whitening, mixed, normal, gradient):
    """Add a sample's residuals to the lower half of a block's normal equations; their cost."""
    cost = 0.0
    for b in range(errors.shape[0]):
        mixed[:] = 0.0
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
def correct(x, derivatives, errors, rows, gains, motion):
    """Correct a predicted state and the disturbances by what was measured, as an observer does."""
    gain, disturbance_gain, decay = gains
    z, n, disturbed = derivatives.z, derivatives.n, derivatives.disturbed
    for row in range(N_ROWS):
        motion.disturbance[row] *= decay[row]
        for j in range(1, n):
            disturbed[row, j] *= decay[row]
        for a in range(errors.shape[0]):
            motion.disturbance[row] += disturbance_gain[row, a] * errors[a]
            for j in range(1, n):
                disturbed[row, j] -= disturbance_gain[row, a] * rows[a, j]
    for i in range(2 * N_ROWS):
        for a in range(errors.shape[0]):
            x[i] += gain[i, a] * errors[a]
            for j in range(1, n):
                z[i * WIDTH + j] -= gain[i, a] * rows[a, j]


@uncounted
def mirror(normal):
    """Fill the upper half of a symmetric matrix."""
    for j in range(normal.shape[0]):
        for i in range(j):
            normal[i, j] = normal[j, i]


# Room for one segment: state, its rates, the residuals of a sample, their derivatives and one
# combination of these, and the steps of the integrator; the columns of what is sought; and what no
# segment changes: the noise of each row's position, which outputs are late, and rows none of which
# can stick.
Room = namedtuple(
    "Room",
    "x rate errors rows mixed derivatives step alone modes at delay u du bends disturbance noise "
    "is_late never_sticks",
)


@uncounted
def run_segment(s, segments, sensors, model, substeps, room, results):
    """Add a segment to the normal equations of its blocks; its cost, infinite if it diverged."""
    starts, lengths, first_blocks, sample_times, initial_states = segments
    outputs, measured, reference, late, late_columns, whitening, speeds = sensors
    drives, p, c, dry, observer = model
    x, rate, errors, rows, mixed, derivatives, step, alone, modes, at, delay, u, du, bends = room[
        :14
    ]
    disturbance, noise, is_late, never_sticks = room[14:]
    normal, gradient, residuals, _ = results
    gain, disturbance_gain, decay, directions, corrected = observer
    observed = gain.shape[2] > 0
    directed = observed
    any_late = is_late.any() and not observed
    cost, h = 0.0, sample_times[s]
    for i in range(N_STATES):
        x[i] = initial_states[s, i]
    disturbance[:] = 0.0
    start_derivatives(derivatives)
    drive = drives[starts[s]]
    can_stick = never_sticks if observed else dry
    motion = Motion(drive, modes, can_stick, p[s], c, at, delay, u, du, bends, disturbance)
    first_modes(x, derivatives, h, noise, motion, alone)
    blocks = first_blocks[s + 1] - first_blocks[s]
    for k in range(starts[s], starts[s] + lengths[s]):
        b = first_blocks[s] + (k - starts[s]) * blocks // lengths[s]
        if k > starts[s]:
            drive = drives[k - 1]
            if directed and k - starts[s] >= corrected[s]:  # from here on the model is alone
                directed, can_stick = False, dry
                motion = Motion(drive, modes, dry, p[s], c, at, delay, u, du, bends, disturbance)
                first_modes(x, derivatives, h, noise, motion, alone)
            if directed:
                for row in range(N_ROWS):
                    modes[row] = directions[k - 1, row]
            motion = Motion(drive, modes, can_stick, p[s], c, at, delay, u, du, bends, disturbance)
            cross_interval(x, derivatives, h, substeps, motion, step, alone)
        drive = drives[k]
        motion = Motion(drive, modes, can_stick, p[s], c, at, delay, u, du, bends, disturbance)
        if any_late:
            rates_at(x, 0.0, motion, rate)
            if derivatives.n > 1:
                slopes_at(x, 0.0, 0, motion, derivatives)
        for a in range(measured.shape[0]):
            state = measured[a]
            row = rows[a]
            row[:] = 0.0
            row[0] = x[state]
            for j in range(1, derivatives.n):
                row[j] = derivatives.z[state * WIDTH + j]
            if observed:  # outputs come on time, with their own rates
                if late_columns[a] >= 0:
                    row[1 + late_columns[a]] -= speeds[k, a]
            elif is_late[a]:
                sensor = state, reference[a], late[a], late_columns[a]
                add_delay(row, x, rate, derivatives, drives[k], h, sensor)
            errors[a] = outputs[k, a] - row[0]
            if not abs(errors[a]) < BOUND:
                return np.inf
            residuals[k, a] = errors[a]
        cost += add_residuals(errors, rows, whitening[s], mixed, normal[b], gradient[b])
        if observed:
            if k - starts[s] >= corrected[s]:
                errors[:] = 0.0
            gains = gain[s], disturbance_gain[s], decay[s]
            correct(x, derivatives, errors, rows, gains, motion)
    for b in range(first_blocks[s], first_blocks[s + 1]):
        mirror(normal[b])
    return cost


@njit(cache=True, error_model="numpy", nogil=True)
def segment_equations(part, segments, sensors, model, substeps, sought, results):
    """Normal equations of every block for its segment's initial state and what is sought.

    part      the first segment, and the one that is no longer taken: threads that have different
              ones do not meet
    segments  first sample, number of samples, first block and sample time of each, and its initial
              state; segment s is made up of the blocks first_blocks[s] to first_blocks[s + 1] - 1,
              all of about the same length
    sensors   outputs, shape (n, n_outputs), and of each column a the state that it measures, less
              the state reference[a], if that is not -1, or less the input -2 - reference[a], if
              that is below, of which the next input is the velocity, as far as delays go; the
              delay in s, the place of that among what is sought (-1: not sought), for each segment
              the lower triangle that whitens the outputs' noise, and, where an observer follows
              outputs that were moved beforehand, their rates
    model     drives[k], of each input over the interval from sample k on its start and its change,
              and the derivatives of both by the delay; coefficients of each segment; constants;
              which rows can stick; and the observer: for each segment the gains of the states and
              of the disturbances, one column for each output, or none, and what an interval leaves
              of a disturbance; the direction of each row's friction over the interval from
              each sample on; and after how many samples of a segment the model runs alone
    sought    places of the coefficients, and whether the input's delay is sought after them
    results   filled, all zero before: normal equations, shape (n_blocks, n, n), their right-hand
              sides, shape (n_blocks, n), residuals, shape of the outputs, and the weighted sum of
              squares of each segment: infinite, and then the last one, if its motion diverged.
              If n is 0, the motion runs without derivatives
    """
    _, measured, _, late, late_columns, whitening, _ = sensors
    wanted, delay_sought = sought
    normal, _, _, costs = results
    observed = model[4][0].shape[2] > 0
    carried = 0
    if normal.shape[1] > 0:
        carried = N_STATES + wanted.shape[0] + (1 if delay_sought else 0)
    by_delay = carried if delay_sought else 0
    if observed:  # what corrects the state depends on how late the outputs are
        carried = normal.shape[1]
    at = np.zeros(N_COEFFICIENTS, np.int64)
    for j in range(wanted.shape[0]):
        at[wanted[j]] = 1 + N_STATES + j
    room = Room(
        np.empty(N_STATES),
        np.empty(N_STATES),
        np.zeros(measured.shape[0]),
        np.zeros((measured.shape[0], 1 + normal.shape[1])),
        np.zeros(normal.shape[1]),
        room_for_derivatives(1 + carried, observed),
        room_for_a_step(),
        room_for_a_step(),  # by which an event is located
        np.empty(N_ROWS),
        at,
        by_delay,
        np.empty(N_INPUTS),
        np.empty(N_INPUTS),
        np.empty((2, N_CORNERS)),
        np.zeros(N_ROWS),
        position_noise(measured, whitening),
        (late != 0.0) | (late_columns >= 0),
        np.zeros(N_ROWS, np.bool_),
    )
    for s in range(part[0], part[1]):
        costs[s] = run_segment(s, segments, sensors, model, substeps, room, results)
        if not costs[s] < np.inf:
            return
