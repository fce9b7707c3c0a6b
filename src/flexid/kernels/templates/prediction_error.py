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
def position_noise(measured, weights):
    """Standard deviation of each row's position; 0 where it is not measured."""
    noise = np.zeros(N_ROWS)
    for a in range(measured.shape[0]):
        if measured[a] % 2 == 0:
            noise[measured[a] // 2] = 1.0 / weights[a]
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
    z, n, by_state, by_rest, _, _ = derivatives
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
def add_residual(residual, row, weight, normal, gradient):
    """Add a residual to the lower half of a block's normal equations; its share of the cost."""
    square = weight * weight
    for j in range(gradient.shape[0]):
        weighted = square * row[1 + j]
        gradient[j] += weighted * residual
        for i in range(j + 1):
            normal[j, i] += weighted * row[1 + i]
    return square * residual * residual


@uncounted
def mirror(normal):
    """Fill the upper half of a symmetric matrix."""
    for j in range(normal.shape[0]):
        for i in range(j):
            normal[i, j] = normal[j, i]


# Room for one segment: state, its rates, a residual's derivatives, and the steps of the integrator;
# the columns of what is sought; and what no segment changes: the noise of each row's position, and
# which outputs are late.
Room = namedtuple(
    "Room", "x rate row derivatives step alone modes at delay u du bends noise is_late"
)


@uncounted
def run_segment(s, segments, sensors, model, substeps, room, results):
    """Add a segment to the normal equations of its blocks; its cost, infinite if it diverged."""
    starts, lengths, first_blocks, sample_times, initial_states = segments
    outputs, measured, reference, late, late_columns, weights = sensors
    drives, p, c, dry = model
    x, rate, row, derivatives, step, alone, modes, at, delay, u, du, bends, noise, is_late = room
    normal, gradient, residuals, _ = results
    any_late = is_late.any()
    cost, h = 0.0, sample_times[s]
    for i in range(N_STATES):
        x[i] = initial_states[s, i]
    start_derivatives(derivatives)
    motion = Motion(drives[starts[s]], modes, dry, p[s], c, at, delay, u, du, bends)
    first_modes(x, derivatives, h, noise, motion, alone)
    blocks = first_blocks[s + 1] - first_blocks[s]
    for k in range(starts[s], starts[s] + lengths[s]):
        b = first_blocks[s] + (k - starts[s]) * blocks // lengths[s]
        if k > starts[s]:
            motion = Motion(drives[k - 1], modes, dry, p[s], c, at, delay, u, du, bends)
            cross_interval(x, derivatives, h, substeps, motion, step, alone)
        if any_late:
            motion = Motion(drives[k], modes, dry, p[s], c, at, delay, u, du, bends)
            rates_at(x, 0.0, motion, rate)
            if derivatives.n > 1:
                slopes_at(x, 0.0, 0, motion, derivatives)
        for a in range(measured.shape[0]):
            state = measured[a]
            row[:] = 0.0
            row[0] = x[state]
            for j in range(1, derivatives.n):
                row[j] = derivatives.z[state * WIDTH + j]
            if is_late[a]:
                sensor = state, reference[a], late[a], late_columns[a]
                add_delay(row, x, rate, derivatives, drives[k], h, sensor)
            residual = outputs[k, a] - row[0]
            if not abs(residual) < BOUND:
                return np.inf
            residuals[k, a] = residual
            cost += add_residual(residual, row, weights[a], normal[b], gradient[b])
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
              delay in s, the place of that among what is sought (-1: not sought), and the weight:
              one over the standard deviation
    model     drives[k], of each input over the interval from sample k on its start and its change,
              and the derivatives of both by the delay; coefficients of each segment; constants;
              which rows can stick
    sought    places of the coefficients, and whether the input's delay is sought after them
    results   filled, all zero before: normal equations, shape (n_blocks, n, n), their right-hand
              sides, shape (n_blocks, n), residuals, shape of the outputs, and the weighted sum of
              squares of each segment: infinite, and then the last one, if its motion diverged.
              If n is 0, the motion runs without derivatives
    """
    _, measured, _, late, late_columns, weights = sensors
    wanted, delay_sought = sought
    normal, _, _, costs = results
    carried = 0
    if normal.shape[1] > 0:
        carried = N_STATES + wanted.shape[0] + (1 if delay_sought else 0)
    at = np.zeros(N_COEFFICIENTS, np.int64)
    for j in range(wanted.shape[0]):
        at[wanted[j]] = 1 + N_STATES + j
    room = Room(
        np.empty(N_STATES),
        np.empty(N_STATES),
        np.zeros(1 + normal.shape[1]),
        room_for_derivatives(1 + carried),
        room_for_a_step(),
        room_for_a_step(),  # by which an event is located
        np.empty(N_ROWS),
        at,
        carried if delay_sought else 0,
        np.empty(N_INPUTS),
        np.empty(N_INPUTS),
        np.empty((2, N_CORNERS)),
        position_noise(measured, weights),
        (late != 0.0) | (late_columns >= 0),
    )
    for s in range(part[0], part[1]):
        costs[s] = run_segment(s, segments, sensors, model, substeps, room, results)
        if not costs[s] < np.inf:
            return
