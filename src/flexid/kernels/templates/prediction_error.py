"""Motion over segments with its sensitivities, and the normal equations of its residuals.

Dry friction is set-valued. Each row has a mode: 1 or -1 while it slides, which is the sign of its
velocity, and 0 while it sticks. A change of mode is located within a step; positions and
velocities are continuous there, and so are their derivatives, but for those of velocities:
    reversal   S+ = S- + (a- - a+) t',  t' = -S-/a- of the row that turns,
    sticking   S+ = 0 in the row that stops,
    release    S+ = S-.
"""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import (
        N_COEFFICIENTS,
        N_INPUTS,
        N_ROWS,
        N_STATES,
        variation_rates,
    )


BOUND = 1e12  # a residual beyond it means that the segment diverged
MOST_EVENTS = 12  # changes of mode within one sampling interval; then it runs on as it is
MOST_TRIALS = 8  # of the secant that locates a change
STOPPING_SAMPLES = 3.0  # within which a row stops that counts as stuck from the start
NEAR = 1e-9  # of an interval, to which a change is located


@njit(cache=True, error_model="numpy")
def rates_at(z, drive, place, modes, dry, p, c, at, delay, rate, u, du):
    """Rates of z at a place within the interval; rows that stick do not move."""
    for j in range(N_INPUTS):
        u[j] = drive[j, 0] + place * drive[j, 1]
        du[j] = drive[j, 2] + place * drive[j, 3]
    variation_rates(z, u, du, modes, p, c, at, delay, rate)
    for row in range(N_ROWS):
        if dry[row] and modes[row] == 0.0:
            for j in range(z.shape[1]):
                rate[2 * row, j] = 0.0
                rate[2 * row + 1, j] = 0.0


@njit(cache=True, error_model="numpy")
def runge_kutta(z, drive, place, span, h, modes, dry, p, c, at, delay, end, rate, trial, u, du):
    """Classical Runge-Kutta over a span of the interval, from z to end."""
    step = span * h
    end[:] = z
    trial[:] = z
    for stage in range(4):
        node = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        reach = 0.5 if stage < 2 else 1.0
        weight = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
        rates_at(trial, drive, place + node * span, modes, dry, p, c, at, delay, rate, u, du)
        for i in range(N_STATES):
            for j in range(z.shape[1]):
                end[i, j] += weight * rate[i, j]
                trial[i, j] = z[i, j] + reach * step * rate[i, j]


@njit(cache=True, error_model="numpy")
def pull(z, row, side, drive, place, modes, dry, p, c, at, delay, rate, u, du):
    """Acceleration of a row at rest if its friction were that of sliding to a side."""
    kept = modes[row]
    modes[row] = side
    rates_at(z, drive, place, modes, dry, p, c, at, delay, rate, u, du)
    modes[row] = kept
    return rate[2 * row + 1, 0]


@njit(cache=True, error_model="numpy")
def margin(z, row, drive, place, modes, dry, p, c, at, delay, rate, u, du):
    """Positive as long as a row stays in its mode: its speed, or what friction has in reserve."""
    if modes[row] != 0.0:
        return modes[row] * z[2 * row + 1, 0]
    forward = pull(z, row, 1.0, drive, place, modes, dry, p, c, at, delay, rate, u, du)
    backward = pull(z, row, -1.0, drive, place, modes, dry, p, c, at, delay, rate, u, du)
    return min(-forward, backward)


@njit(cache=True, error_model="numpy")
def change_mode(z, row, drive, place, modes, dry, p, c, at, delay, rate, other, u, du):
    """Let a row whose margin is used up change its mode: reverse, stick, or let go."""
    velocity = 2 * row + 1
    forward = pull(z, row, 1.0, drive, place, modes, dry, p, c, at, delay, rate, u, du)
    backward = pull(z, row, -1.0, drive, place, modes, dry, p, c, at, delay, rate, u, du)
    old = modes[row]
    if old == 0.0:
        modes[row] = 1.0 if forward > -backward else -1.0
        return
    before = forward if old > 0.0 else backward
    after = backward if old > 0.0 else forward
    z[velocity, 0] = 0.0
    through = after * old < 0.0
    if through and before * old < 0.0:
        rates_at(z, drive, place, modes, dry, p, c, at, delay, other, u, du)
        modes[row] = -old
        rates_at(z, drive, place, modes, dry, p, c, at, delay, rate, u, du)
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
def first_modes(z, drive, h, trace, modes, dry, p, c, at, delay, rate, u, du):
    """Modes at the start of a segment; a row that would stop within a few samples sticks at once.

    How fast such a row was leaves no trace in its positions, if it moves by less than `trace`, and
    a fit must not chase it.
    """
    for row in range(N_ROWS):
        velocity = z[2 * row + 1, 0]
        modes[row] = -1.0 if velocity < 0.0 else 1.0
        if not dry[row]:
            continue
        forward = pull(z, row, 1.0, drive, 0.0, modes, dry, p, c, at, delay, rate, u, du)
        backward = pull(z, row, -1.0, drive, 0.0, modes, dry, p, c, at, delay, rate, u, du)
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
def leaving_row(z, end, drive, place, span, modes, dry, p, c, at, delay, rate, u, du):
    """The row whose mode ends first within a span, by linear interpolation; or -1."""
    chosen, earliest = -1, 2.0
    for row in range(N_ROWS):
        if dry[row]:
            last = margin(end, row, drive, place + span, modes, dry, p, c, at, delay, rate, u, du)
            if last < 0.0:
                first = margin(z, row, drive, place, modes, dry, p, c, at, delay, rate, u, du)
                when = max(first, 0.0) / (max(first, 0.0) - last)
                if when < earliest:
                    chosen, earliest = row, when
    return chosen


@njit(cache=True, error_model="numpy")
def span_to_change(
    z, row, drive, place, span, h, modes, dry, p, c, at, delay, end, rate, trial, u, du
):
    """Span after which the margin of a row is used up (regula falsi after Illinois)."""
    low, high = 0.0, span
    at_low = max(margin(z, row, drive, place, modes, dry, p, c, at, delay, rate, u, du), 0.0)
    at_high = margin(end, row, drive, place + span, modes, dry, p, c, at, delay, rate, u, du)
    found = high
    for _ in range(MOST_TRIALS):
        found = low + (high - low) * at_low / (at_low - at_high)
        if found - low < NEAR or high - found < NEAR:
            break
        runge_kutta(z, drive, place, found, h, modes, dry, p, c, at, delay, end, rate, trial, u, du)
        value = margin(end, row, drive, place + found, modes, dry, p, c, at, delay, rate, u, du)
        if value < 0.0:
            high, at_high = found, value
            at_low *= 0.5
        else:
            low, at_low = found, value
            at_high *= 0.5
    return found


@njit(cache=True, error_model="numpy")
def advance(z, drive, h, substeps, modes, dry, p, c, at, delay, end, rate, trial, other, u, du):
    """Bring z over one sampling interval, in place."""
    place, events = 0.0, 0
    any_dry = False
    for row in range(N_ROWS):
        any_dry = any_dry or dry[row]
    while place < 1.0 - NEAR:
        span = min(1.0 / substeps, 1.0 - place)
        runge_kutta(z, drive, place, span, h, modes, dry, p, c, at, delay, end, rate, trial, u, du)
        row = -1
        if any_dry and events < MOST_EVENTS:
            row = leaving_row(z, end, drive, place, span, modes, dry, p, c, at, delay, rate, u, du)
        if row >= 0:
            span = span_to_change(
                z, row, drive, place, span, h, modes, dry, p, c, at, delay, end, rate, trial, u, du
            )
            runge_kutta(
                z, drive, place, span, h, modes, dry, p, c, at, delay, end, rate, trial, u, du
            )
            change_mode(
                end, row, drive, place + span, modes, dry, p, c, at, delay, rate, other, u, du
            )
            events += 1
        z[:] = end
        place += span


@njit(cache=True, error_model="numpy", nogil=True)
def segment_equations(
    first,
    stop,
    starts,
    lengths,
    first_blocks,
    sample_times,
    initial_states,
    measured,
    late,
    late_columns,
    reference,
    outputs,
    weights,
    drives,
    p,
    c,
    wanted,
    delay_sought,
    dry,
    substeps,
    normal,
    gradient,
    residuals,
    costs,
):
    """Normal equations of every block for its segment's initial state and what is sought.

    Of the segments from `first` up to, not including, `stop`: threads that have different ones do
    not meet. Segment s begins at sample starts[s], is made up of the blocks first_blocks[s] to
    first_blocks[s + 1] - 1, all of about the same length, and has the coefficients p[s], of which
    those at the places `wanted` are sought, then the input's delay if `delay_sought`, then the
    delays of outputs at their places `late_columns` (-1: not sought). Column a of `outputs`
    measures the state measured[a] (less the state reference[a], if that is not -1, as far as
    delays go) as it was late[a] seconds before, and weighs weights[a] (one over its standard
    deviation). drives[k] holds, of each input over the interval from sample k on, its start and
    its change, and the derivatives of both by the delay. Fills `normal`, shape (n_blocks, n, n),
    `gradient`, shape (n_blocks, n), all zero before, `residuals`, shape of `outputs`, and `costs`,
    shape (n_segments,), with the weighted sum of squares of each segment: infinite, and then the
    last one, if its motion diverged.
    """
    size = normal.shape[1]
    carried = N_STATES + wanted.shape[0] + (1 if delay_sought else 0)
    delay = carried if delay_sought else 0
    at = np.zeros(N_COEFFICIENTS, np.int64)
    for j in range(wanted.shape[0]):
        at[wanted[j]] = 1 + N_STATES + j
    z = np.empty((N_STATES, 1 + carried))
    rate = np.empty((N_STATES, 1 + carried))
    trial = np.empty((N_STATES, 1 + carried))
    end = np.empty((N_STATES, 1 + carried))
    other = np.empty((N_STATES, 1 + carried))
    row = np.zeros(1 + size)
    u = np.empty(N_INPUTS)
    du = np.empty(N_INPUTS)
    modes = np.empty(N_ROWS)
    trace = np.zeros(N_ROWS)  # the noise of each row's position
    for a in range(measured.shape[0]):
        if measured[a] % 2 == 0:
            trace[measured[a] // 2] = 1.0 / weights[a]
    any_late = False
    for a in range(measured.shape[0]):
        any_late = any_late or late[a] != 0.0 or late_columns[a] >= 0
    for s in range(first, stop):
        cost = 0.0
        z[:] = 0.0
        for i in range(N_STATES):
            z[i, 0] = initial_states[s, i]
            z[i, 1 + i] = 1.0
        h = sample_times[s]
        first_modes(z, drives[starts[s]], h, trace, modes, dry, p[s], c, at, delay, rate, u, du)
        blocks = first_blocks[s + 1] - first_blocks[s]
        for k in range(starts[s], starts[s] + lengths[s]):
            b = first_blocks[s] + (k - starts[s]) * blocks // lengths[s]
            if k > starts[s]:
                advance(
                    z,
                    drives[k - 1],
                    sample_times[s],
                    substeps,
                    modes,
                    dry,
                    p[s],
                    c,
                    at,
                    delay,
                    end,
                    rate,
                    trial,
                    other,
                    u,
                    du,
                )
            if any_late:
                rates_at(z, drives[k], 0.0, modes, dry, p[s], c, at, delay, rate, u, du)
            for a in range(measured.shape[0]):
                state = measured[a]
                row[:] = 0.0
                row[: 1 + carried] = z[state]
                if late[a] != 0.0 or late_columns[a] >= 0:
                    for j in range(1 + carried):
                        speed, acceleration = z[state + 1, j], rate[state + 1, j]
                        if reference[a] >= 0:
                            speed -= z[reference[a] + 1, j]
                            acceleration -= rate[reference[a] + 1, j]
                        row[j] += late[a] * (0.5 * late[a] * acceleration - speed)
                        if j == 0 and late_columns[a] >= 0:
                            row[1 + late_columns[a]] = late[a] * acceleration - speed
                residual = outputs[k, a] - row[0]
                if not abs(residual) < BOUND:
                    costs[s] = np.inf
                    return
                residuals[k, a] = residual
                square = weights[a] * weights[a]
                cost += square * residual * residual
                for j in range(size):
                    weighted = square * row[1 + j]
                    gradient[b, j] += weighted * residual
                    for i in range(j + 1):
                        normal[b, j, i] += weighted * row[1 + i]
        for b in range(first_blocks[s], first_blocks[s + 1]):
            for j in range(size):
                for i in range(j):
                    normal[b, i, j] = normal[b, j, i]
        costs[s] = cost
