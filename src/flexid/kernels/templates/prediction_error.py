"""Motion over segments with its sensitivities, and the normal equations of its residuals.

Dry friction is set-valued. Each row has a mode: 1 or -1 while it slides, which is the sign of its
velocity, and 0 while it sticks. A change of mode is located within a step; positions and
velocities are continuous there, and so are their derivatives, but for those of velocities:
    reversal   S+ = S- + (a- - a+) t',  t' = -S-/a- of the row that turns,
    sticking   S+ = 0 in the row that stops,
    release    S+ = S-.
"""

from collections import namedtuple
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.bound import BOUND
    from flexid.kernels.templates.generated import (
        N_COEFFICIENTS,
        N_INPUTS,
        N_ROWS,
        N_STATES,
        remember,
        variation_rates,
    )
    from flexid.kernels.templates.runge_kutta import runge_kutta

MOST_EVENTS = 12  # changes of mode within one sampling interval; then it runs on as it is
MOST_TRIALS = 8  # of the secant that locates a change
STOPPING_SAMPLES = 3.0  # within which a row stops that counts as stuck from the start
NEAR = 1e-9  # of an interval, to which a change is located

# What moves the model over one interval, beside its state: each input's start and change with their
# derivatives by the delay; the mode of each row, and whether it can stick; coefficients, constants;
# the column of each coefficient and of the delay; and room for the inputs and their derivatives.
Motion = namedtuple("Motion", "drive modes dry p c at delay u du")


@njit(cache=True, error_model="numpy")
def rates_at(z, place, motion, rate):
    """Rates of z at a place within the interval; rows that stick do not move."""
    drive, modes, u, du = motion.drive, motion.modes, motion.u, motion.du
    for j in range(N_INPUTS):
        u[j] = drive[j, 0] + place * drive[j, 1]
        du[j] = drive[j, 2] + place * drive[j, 3]
    variation_rates(z, u, du, modes, motion.p, motion.c, motion.at, motion.delay, rate)
    for row in range(N_ROWS):
        if motion.dry[row] and modes[row] == 0.0:
            for j in range(z.shape[1]):
                rate[2 * row, j] = 0.0
                rate[2 * row + 1, j] = 0.0


@njit(cache=True, error_model="numpy")
def recall(z, start, motion):
    """Set the memories of z to what its path since the start of a step makes of them."""
    remember(z, start, motion.p, motion.at)


@njit(cache=True, error_model="numpy")
def pull(z, row, side, place, motion, alone):
    """Acceleration of a row at rest if its friction were that of sliding to a side."""
    _, rate, state = alone
    for i in range(N_STATES):
        state[i, 0] = z[i, 0]
    modes = motion.modes
    kept = modes[row]
    modes[row] = side
    rates_at(state, place, motion, rate)
    modes[row] = kept
    return rate[2 * row + 1, 0]


@njit(cache=True, error_model="numpy")
def margin(z, row, place, motion, alone):
    """Positive as long as a row stays in its mode: its speed, or what friction has in reserve."""
    mode = motion.modes[row]
    if mode != 0.0:
        return mode * z[2 * row + 1, 0]
    forward = pull(z, row, 1.0, place, motion, alone)
    backward = pull(z, row, -1.0, place, motion, alone)
    return min(-forward, backward)


@njit(cache=True, error_model="numpy")
def change_mode(z, row, place, motion, alone, rate, other):
    """Let a row whose margin is used up change its mode: reverse, stick, or let go."""
    modes = motion.modes
    velocity = 2 * row + 1
    forward = pull(z, row, 1.0, place, motion, alone)
    backward = pull(z, row, -1.0, place, motion, alone)
    old = modes[row]
    if old == 0.0:
        modes[row] = 1.0 if forward > -backward else -1.0
        return
    before = forward if old > 0.0 else backward
    after = backward if old > 0.0 else forward
    z[velocity, 0] = 0.0
    through = after * old < 0.0
    if through and before * old < 0.0:
        rates_at(z, place, motion, other)
        modes[row] = -old
        rates_at(z, place, motion, rate)
        for j in range(1, z.shape[1]):
            later = -z[velocity, j] / before
            for i in range(N_ROWS):
                z[2 * i + 1, j] += (other[2 * i + 1, 0] - rate[2 * i + 1, 0]) * later
    elif through:
        modes[row] = -old
    else:
        modes[row] = 0.0
        for j in range(z.shape[1]):
            z[velocity, j] = 0.0


@njit(cache=True, error_model="numpy")
def first_modes(z, h, trace, motion, alone):
    """Modes at the start of a segment; a row that would stop within a few samples sticks at once.

    How fast such a row was leaves no trace in its positions, if it moves by less than `trace`, and
    a fit must not chase it.
    """
    modes = motion.modes
    for row in range(N_ROWS):
        velocity = z[2 * row + 1, 0]
        modes[row] = -1.0 if velocity < 0.0 else 1.0
        if not motion.dry[row]:
            continue
        forward = pull(z, row, 1.0, 0.0, motion, alone)
        backward = pull(z, row, -1.0, 0.0, motion, alone)
        braking = -forward if velocity >= 0.0 else backward
        soon = abs(velocity) <= STOPPING_SAMPLES * h * braking
        near = velocity * velocity <= 2.0 * braking * trace[row]
        if forward <= 0.0 <= backward and soon and near:
            modes[row] = 0.0
            for j in range(z.shape[1]):
                z[2 * row + 1, j] = 0.0
        elif velocity == 0.0:
            modes[row] = 1.0 if forward > -backward else -1.0


@njit(cache=True, error_model="numpy")
def leaving_row(z, place, span, h, motion, work, alone):
    """The row whose mode ends first, by linear interpolation, and a span within which it does.

    It is -1 where none ends within the span that `work` holds the end of. A held input jumps
    between two intervals: it may let go of a row that stuck, and hold it again before the interval
    ends.
    """
    end, rate, _ = work
    chosen, earliest, reach = -1, 2.0, span
    for row in range(N_ROWS):
        if motion.dry[row]:
            mode = motion.modes[row]
            last = margin(end, row, place + span, motion, alone)
            when, within = 2.0, span
            if last < 0.0 or mode == 0.0:
                first = margin(z, row, place, motion, alone)
                if first < 0.0:
                    when = 0.0
                elif last < 0.0:
                    when = first / (first - last)
            else:
                rise = mode * rate[2 * row + 1, 0] * h
                lowest, least = turning_point(z, row, place, span, last, rise, h, motion, alone)
                if least < 0.0:
                    first = mode * z[2 * row + 1, 0]
                    when, within = lowest / span * first / (first - least), lowest
            if when < earliest:
                chosen, earliest, reach = row, when, within
    return chosen, reach


@njit(cache=True, error_model="numpy")
def turning_point(z, row, place, span, last, rise, h, motion, alone):
    """Span after which a row that slides is slowest, and its margin there.

    A row may turn back and forth within one span and slide at its end as it did at its start; the
    margin is that of the end where it cannot have done so, by a parabola through both ends with
    the slope at the end.
    """
    mode = motion.modes[row]
    first = mode * z[2 * row + 1, 0]
    fall = rise - 2.0 * (last - first) / span
    if first <= 0.0 or rise <= 0.0 or fall <= 0.0 or last >= rise * span:
        return span, last
    fall = -mode * pull(z, row, mode, place, motion, alone) * h
    if fall <= 0.0:
        return span, last
    lowest = span * fall / (fall + rise)
    runge_kutta(z, place, lowest, h, motion, alone)
    return lowest, mode * alone[0][2 * row + 1, 0]


@njit(cache=True, error_model="numpy")
def span_to_change(z, row, place, span, h, motion, alone):
    """Span after which the margin of a row is used up (regula falsi after Illinois)."""
    end = alone[0]
    low, high = 0.0, span
    at_low = margin(z, row, place, motion, alone)
    runge_kutta(z, place, span, h, motion, alone)
    at_high = margin(end, row, place + span, motion, alone)
    if at_low <= 0.0:
        side = motion.modes[row]
        gain = side * pull(z, row, side, place, motion, alone)
        if side == 0.0 or gain <= 0.0:
            return 0.0
        # It has just been let go and comes to rest again: at constant jerk, not before this.
        low = 0.5 * span * gain * span * h / (gain * span * h - at_high)
        runge_kutta(z, place, low, h, motion, alone)
        at_low = margin(end, row, place + low, motion, alone)
        if at_low <= 0.0:
            return low
    found = high
    for _ in range(MOST_TRIALS):
        found = low + (high - low) * at_low / (at_low - at_high)
        if found - low < NEAR or high - found < NEAR:
            break
        runge_kutta(z, place, found, h, motion, alone)
        value = margin(end, row, place + found, motion, alone)
        if value < 0.0:
            high, at_high = found, value
            at_low *= 0.5
        else:
            low, at_low = found, value
            at_high *= 0.5
    return found


@njit(cache=True, error_model="numpy")
def cross_interval(z, h, substeps, motion, work, alone, other):
    """Bring z over one sampling interval, in place."""
    end, rate, _ = work
    place, events = 0.0, 0
    any_dry = False
    for row in range(N_ROWS):
        any_dry = any_dry or motion.dry[row]
    while place < 1.0 - NEAR:
        span = min(1.0 / substeps, 1.0 - place)
        runge_kutta(z, place, span, h, motion, work)
        row, reach = -1, span
        if any_dry and events < MOST_EVENTS:
            row, reach = leaving_row(z, place, span, h, motion, work, alone)
        if row >= 0:
            span = span_to_change(z, row, place, reach, h, motion, alone)
            runge_kutta(z, place, span, h, motion, work)
            change_mode(end, row, place + span, motion, alone, rate, other)
            events += 1
        z[:] = end
        place += span


@njit(cache=True, error_model="numpy")
def position_noise(measured, weights):
    """Standard deviation of each row's position; 0 where it is not measured."""
    noise = np.zeros(N_ROWS)
    for a in range(measured.shape[0]):
        if measured[a] % 2 == 0:
            noise[measured[a] // 2] = 1.0 / weights[a]
    return noise


@njit(cache=True, error_model="numpy")
def add_delay(row, z, rate, drive, h, sensor):
    """Move what an output should be, and its derivatives, to when the output is true.

    sensor    the state that it measures; the state that it is relative to, if that is not -1, or
              the input -2 - that, if it is below; the delay in s, and its place among what is
              sought
    """
    state, reference, late, late_column = sensor
    for j in range(z.shape[1]):
        speed, acceleration = z[state + 1, j], rate[state + 1, j]
        if reference >= 0:
            speed -= z[reference + 1, j]
            acceleration -= rate[reference + 1, j]
        elif reference < -1 and j == 0:
            i = -1 - reference  # the input after it, which is its velocity
            speed -= drive[i, 0]
            acceleration -= drive[i, 1] / h
        row[j] += late * (0.5 * late * acceleration - speed)
        if j == 0 and late_column >= 0:
            row[1 + late_column] = late * acceleration - speed


@njit(cache=True, error_model="numpy")
def add_residual(residual, row, weight, normal, gradient):
    """Add a residual to the lower half of a block's normal equations; its share of the cost."""
    square = weight * weight
    for j in range(gradient.shape[0]):
        weighted = square * row[1 + j]
        gradient[j] += weighted * residual
        for i in range(j + 1):
            normal[j, i] += weighted * row[1 + i]
    return square * residual * residual


@njit(cache=True, error_model="numpy")
def mirror(normal):
    """Fill the upper half of a symmetric matrix."""
    for j in range(normal.shape[0]):
        for i in range(j):
            normal[i, j] = normal[j, i]


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
              squares of each segment: infinite, and then the last one, if its motion diverged
    """
    first, stop = part
    starts, lengths, first_blocks, sample_times, initial_states = segments
    outputs, measured, reference, late, late_columns, weights = sensors
    drives, p, c, dry = model
    wanted, delay_sought = sought
    normal, gradient, residuals, costs = results
    size = normal.shape[1]
    carried = N_STATES + wanted.shape[0] + (1 if delay_sought else 0)
    delay = carried if delay_sought else 0
    at = np.zeros(N_COEFFICIENTS, np.int64)
    for j in range(wanted.shape[0]):
        at[wanted[j]] = 1 + N_STATES + j
    shape = (N_STATES, 1 + carried)
    z, other = np.empty(shape), np.empty(shape)
    work = np.empty(shape), np.empty(shape), np.empty(shape)
    single = (N_STATES, 1)  # the state without its derivatives, which no event is located by
    alone = np.empty(single), np.empty(single), np.empty(single)
    rate = work[1]
    row = np.zeros(1 + size)
    u, du = np.empty(N_INPUTS), np.empty(N_INPUTS)
    modes = np.empty(N_ROWS)
    noise = position_noise(measured, weights)
    is_late = (late != 0.0) | (late_columns >= 0)
    any_late = is_late.any()
    for s in range(first, stop):
        cost = 0.0
        z[:] = 0.0
        for i in range(N_STATES):
            z[i, 0] = initial_states[s, i]
            z[i, 1 + i] = 1.0
        h = sample_times[s]
        motion = Motion(drives[starts[s]], modes, dry, p[s], c, at, delay, u, du)
        first_modes(z, h, noise, motion, alone)
        blocks = first_blocks[s + 1] - first_blocks[s]
        for k in range(starts[s], starts[s] + lengths[s]):
            b = first_blocks[s] + (k - starts[s]) * blocks // lengths[s]
            if k > starts[s]:
                motion = Motion(drives[k - 1], modes, dry, p[s], c, at, delay, u, du)
                cross_interval(z, h, substeps, motion, work, alone, other)
            if any_late:
                motion = Motion(drives[k], modes, dry, p[s], c, at, delay, u, du)
                rates_at(z, 0.0, motion, rate)
            for a in range(measured.shape[0]):
                state = measured[a]
                row[:] = 0.0
                row[: 1 + carried] = z[state]
                if is_late[a]:
                    sensor = state, reference[a], late[a], late_columns[a]
                    add_delay(row, z, rate, drives[k], h, sensor)
                residual = outputs[k, a] - row[0]
                if not abs(residual) < BOUND:
                    costs[s] = np.inf
                    return
                residuals[k, a] = residual
                cost += add_residual(residual, row, weights[a], normal[b], gradient[b])
        for b in range(first_blocks[s], first_blocks[s + 1]):
            mirror(normal[b])
        costs[s] = cost
