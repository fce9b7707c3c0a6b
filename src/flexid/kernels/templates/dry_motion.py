"""Motion with set-valued dry friction, and its derivatives, over one sampling interval.

Each row has a mode: 1 or -1 while it slides, which is the sign of its velocity, and 0 while it
sticks. A change of mode is located within a step; positions and velocities are continuous there,
and so are their derivatives, but for those of velocities:
    reversal   S+ = S- + (a- - a+) t',  t' = -S-/a- of the row that turns,
    sticking   the same, so that S+ = 0 in the row that stops; the others feel it stop if the mass
               matrix couples them,
    release    S+ = S-.

What runs at every stage of a step is `uncounted` or `inlined`: references to arrays cost more than
the mathematics.
"""

from collections import namedtuple
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import (
        N_CORNERS,
        N_INPUTS,
        N_MEMORIES,
        N_ROWS,
        N_STATES,
        WIDTH,
        corners,
        inlined,
        memory_slopes,
        remember,
        slopes,
        state_rates,
        uncounted,
        vary,
    )
    from flexid.kernels.templates.runge_kutta import node, runge_kutta

MOST_EVENTS = 12  # changes of mode within one sampling interval; then it runs on as it is
MOST_TRIALS = 8  # of the secant that locates a change
CORNER_TRIALS = 3  # of that which locates a corner
AT_CORNER = 1e-3  # of an interval, within which a corner is stepped over
STOPPING_SAMPLES = 3.0  # within which a row stops that counts as stuck from the start
NEAR = 1e-9  # of an interval, to which a change is located
# Of the jump of acceleration in a reversal, that before it counts as at least. A friction that
# brakes leaves it no smaller than the jump; next to none is left by one that drives, on which a fit
# may try: derivatives by the moment of turning then hold for no change at all, and drown the rest.
GRAZING = 0.1

# What moves the model over one interval, beside its state: each input's start and change with their
# derivatives by the delay; the mode of each row, and whether it can stick; coefficients, constants;
# the column of each coefficient and of the delay; and room for the inputs, their derivatives, and
# what is zero at each corner, at the start and at the end of a step; and each row's disturbance, an
# acceleration that is constant over the interval.
Motion = namedtuple("Motion", "drive modes dry p c at delay u du bends disturbance")

# The derivatives of the state, columns 1 to n - 1 of z; and what they follow from at each stage of
# a step: those of the rates by the state and by the rest, and those of what a memory keeps. Last,
# the derivatives of each row's disturbance, in the same columns.
Derivatives = namedtuple("Derivatives", "z n by_state by_rest kept_by_state kept_by_rest disturbed")


@njit(cache=True, error_model="numpy")
def room_for_derivatives(n, disturbed):
    """Arrays for derivatives in n - 1 columns, disturbances among what they are of or not."""
    equations = N_ROWS + N_MEMORIES
    return Derivatives(
        np.zeros(N_STATES * WIDTH),
        n,
        np.zeros((4, equations, N_STATES)),
        np.zeros(4 * equations * WIDTH),
        np.zeros((4, N_MEMORIES, N_STATES)),
        np.zeros(4 * N_MEMORIES * WIDTH),
        np.zeros((N_ROWS if disturbed else 0, WIDTH)),
    )


@uncounted
def start_derivatives(derivatives):
    """Let the derivatives be those at the start of a segment."""
    derivatives.z[:] = 0.0
    derivatives.disturbed[:] = 0.0
    for i in range(N_STATES):
        derivatives.z[i * WIDTH + 1 + i] = 1.0


@inlined
def rates_at(x, place, motion, rate):
    """Rates of x at a place within the interval; rows that stick do not move."""
    for j in range(N_INPUTS):
        motion.u[j] = motion.drive[j, 0] + place * motion.drive[j, 1]
    state_rates(x, motion.u, motion.modes, motion.p, motion.c, rate)
    for row in range(N_ROWS):
        rate[2 * row + 1] += motion.disturbance[row]
        if motion.dry[row] and motion.modes[row] == 0.0:
            rate[2 * row] = 0.0
            rate[2 * row + 1] = 0.0


@inlined
def recall(x, start, motion):
    """Set the memories of x to what its path since the start of a step makes of them."""
    remember(x, start, motion.p)


@inlined
def slopes_at(x, place, stage, motion, derivatives):
    """Derivatives of the rates at a place within the interval; rows that stick have none."""
    drive, modes = motion.drive, motion.modes
    for j in range(N_INPUTS):
        motion.u[j] = drive[j, 0] + place * drive[j, 1]
        motion.du[j] = drive[j, 2] + place * drive[j, 3]
    size = (N_ROWS + N_MEMORIES) * WIDTH
    a = derivatives.by_state[stage]
    r = derivatives.by_rest[stage * size : (stage + 1) * size]
    kept = derivatives.n if derivatives.disturbed.shape[0] else 0
    for i in range(N_ROWS * WIDTH if kept else 0):
        r[i] = 0.0  # `slopes` leaves alone what does not depend on the model
    slopes(x, motion.u, motion.du, modes, motion.p, motion.c, motion.at, motion.delay, a, r)
    for row in range(N_ROWS):
        for j in range(1, kept):
            r[row * WIDTH + j] += derivatives.disturbed[row, j]
        if motion.dry[row] and modes[row] == 0.0:
            a[row] = 0.0
            r[row * WIDTH : (row + 1) * WIDTH] = 0.0


@inlined
def carry(derivatives, x, place, span, h, motion, work):
    """Bring the derivatives over the step that took x to the end of the work."""
    end, _, stages = work
    for stage in range(4):
        slopes_at(stages[stage], place + node(stage) * span, stage, motion, derivatives)
        if N_MEMORIES:
            then = stages[stage + 1] if stage < 3 else end
            b = derivatives.kept_by_state[stage]
            size = N_MEMORIES * WIDTH
            q = derivatives.kept_by_rest[stage * size : (stage + 1) * size]
            memory_slopes(then, x, motion.p, motion.at, b, q)
    z, n, a, r, b, q, _ = derivatives
    vary(z, n, span * h, a, r, b, q)


@inlined
def pull(x, row, side, place, motion, alone):
    """Acceleration of a row at rest if its friction were that of sliding to a side."""
    rate = alone[1]
    modes = motion.modes
    kept = modes[row]
    modes[row] = side
    rates_at(x, place, motion, rate)
    modes[row] = kept
    return rate[2 * row + 1]


@inlined
def margin(x, row, place, motion, alone):
    """Positive as long as a row stays in its mode: its speed, or what friction has in reserve."""
    mode = motion.modes[row]
    if mode != 0.0:
        return mode * x[2 * row + 1]
    forward = pull(x, row, 1.0, place, motion, alone)
    backward = pull(x, row, -1.0, place, motion, alone)
    return min(-forward, backward)


@uncounted
def change_mode(x, derivatives, row, place, motion, alone):
    """Let a row whose margin is used up change its mode: reverse, stick, or let go."""
    modes, z, n = motion.modes, derivatives.z, derivatives.n
    velocity = 2 * row + 1
    forward = pull(x, row, 1.0, place, motion, alone)
    backward = pull(x, row, -1.0, place, motion, alone)
    old = modes[row]
    if old == 0.0:
        modes[row] = 1.0 if forward > -backward else -1.0
        return
    before = forward if old > 0.0 else backward
    after = backward if old > 0.0 else forward
    x[velocity] = 0.0
    through = after * old < 0.0
    turned = -old if through else 0.0
    if before * old < 0.0:
        jump, rate, _ = alone
        rates_at(x, place, motion, jump)
        modes[row] = turned
        rates_at(x, place, motion, rate)
        for i in range(N_STATES):
            jump[i] -= rate[i]
        least = GRAZING * abs(jump[velocity])
        if abs(before) < least:
            before = -old * least
        for j in range(1, n):
            later = -z[velocity * WIDTH + j] / before
            for i in range(N_ROWS):
                z[(2 * i + 1) * WIDTH + j] += jump[2 * i + 1] * later
    modes[row] = turned
    if not through:
        z[velocity * WIDTH : velocity * WIDTH + n] = 0.0


@uncounted
def first_modes(x, derivatives, h, trace, motion, alone):
    """Modes at the start of a segment; a row that would stop within a few samples sticks at once.

    How fast such a row was leaves no trace in its positions, if it moves by less than `trace`, and
    a fit must not chase it.
    """
    modes = motion.modes
    for row in range(N_ROWS):
        modes[row] = -1.0 if x[2 * row + 1] < 0.0 else 1.0
    for row in range(N_ROWS):
        velocity = x[2 * row + 1]
        if not motion.dry[row]:
            continue
        forward = pull(x, row, 1.0, 0.0, motion, alone)
        backward = pull(x, row, -1.0, 0.0, motion, alone)
        braking = -forward if velocity >= 0.0 else backward
        soon = abs(velocity) <= STOPPING_SAMPLES * h * braking
        near = velocity * velocity <= 2.0 * braking * trace[row]
        if forward <= 0.0 <= backward and soon and near:
            modes[row] = 0.0
            x[2 * row + 1] = 0.0
            derivatives.z[(2 * row + 1) * WIDTH : (2 * row + 2) * WIDTH] = 0.0
        elif velocity == 0.0:
            modes[row] = 1.0 if forward > -backward else -1.0


@inlined
def leaving_row(x, place, span, h, motion, work, alone):
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
                first = margin(x, row, place, motion, alone)
                if first < 0.0:
                    when = 0.0
                elif last < 0.0:
                    when = first / (first - last)
            else:
                rise = mode * rate[2 * row + 1] * h
                lowest, least = turning_point(x, row, place, span, last, rise, h, motion, alone)
                if least < 0.0:
                    first = mode * x[2 * row + 1]
                    when, within = lowest / span * first / (first - least), lowest
            if when < earliest:
                chosen, earliest, reach = row, when, within
    return chosen, reach


@inlined
def turning_point(x, row, place, span, last, rise, h, motion, alone):
    """Span after which a row that slides is slowest, and its margin there.

    A row may turn back and forth within one span and slide at its end as it did at its start; the
    margin is that of the end where it cannot have done so, by a parabola through both ends with
    the slope at the end.
    """
    mode = motion.modes[row]
    first = mode * x[2 * row + 1]
    fall = rise - 2.0 * (last - first) / span
    if first <= 0.0 or rise <= 0.0 or fall <= 0.0 or last >= rise * span:
        return span, last
    fall = -mode * pull(x, row, mode, place, motion, alone) * h
    if fall <= 0.0:
        return span, last
    lowest = span * fall / (fall + rise)
    runge_kutta(x, place, lowest, h, motion, alone)
    return lowest, mode * alone[0][2 * row + 1]


@uncounted
def span_to_change(x, row, place, span, h, motion, alone):
    """Span after which the margin of a row is used up (regula falsi after Illinois)."""
    end = alone[0]
    low, high = 0.0, span
    at_low = margin(x, row, place, motion, alone)
    runge_kutta(x, place, span, h, motion, alone)
    at_high = margin(end, row, place + span, motion, alone)
    if at_low <= 0.0:
        side = motion.modes[row]
        gain = side * pull(x, row, side, place, motion, alone)
        if side == 0.0 or gain <= 0.0:
            return 0.0
        # It has just been let go and comes to rest again: at constant jerk, not before this.
        low = 0.5 * span * gain * span * h / (gain * span * h - at_high)
        runge_kutta(x, place, low, h, motion, alone)
        at_low = margin(end, row, place + low, motion, alone)
        if at_low <= 0.0:
            return low
    found = high
    for _ in range(MOST_TRIALS):
        found = low + (high - low) * at_low / (at_low - at_high)
        if found - low < NEAR or high - found < NEAR:
            break
        runge_kutta(x, place, found, h, motion, alone)
        value = margin(end, row, place + found, motion, alone)
        if value < 0.0:
            high, at_high = found, value
            at_low *= 0.5
        else:
            low, at_low = found, value
            at_high *= 0.5
    return found


@inlined
def span_to_corner(x, place, span, h, motion, work):
    """Span up to the first corner of the rates, or all of it; the work holds the end of that.

    It ends just before the corner, and the next span just behind: each of the others then has the
    slopes of one side in all its stages.
    """
    end, before, after = work[0], motion.bends[0], motion.bends[1]
    corners(x, motion.p, motion.c, before)
    corners(end, motion.p, motion.c, after)
    first, high = -1, span
    for i in range(N_CORNERS):
        if before[i] * after[i] < 0.0:
            when = span * before[i] / (before[i] - after[i])
            if when < high:
                first, high = i, when
    if first < 0:
        return span
    if high <= AT_CORNER:
        runge_kutta(x, place, min(span, 2.0 * AT_CORNER), h, motion, work)
        return min(span, 2.0 * AT_CORNER)
    low, high, found = 0.0, span, high
    at_low, at_high = before[first], after[first]
    for _ in range(CORNER_TRIALS):
        found = low + (high - low) * at_low / (at_low - at_high)
        runge_kutta(x, place, found, h, motion, work)
        corners(end, motion.p, motion.c, after)
        if after[first] * at_low > 0.0:
            low, at_low = found, after[first]
        else:
            high, at_high = found, after[first]
    just_before = max(found - 0.5 * AT_CORNER, 0.5 * AT_CORNER)
    runge_kutta(x, place, just_before, h, motion, work)
    return just_before


@inlined
def cross_interval(x, derivatives, h, substeps, motion, work, alone):
    """Bring x and its derivatives over one sampling interval, in place."""
    end = work[0]
    place, events, turns = 0.0, 0, 0
    any_dry = False
    for row in range(N_ROWS):
        any_dry = any_dry or motion.dry[row]
    while place < 1.0 - NEAR:
        span = min(1.0 / substeps, 1.0 - place)
        runge_kutta(x, place, span, h, motion, work)
        if N_CORNERS and turns < MOST_EVENTS:
            whole = span
            span = span_to_corner(x, place, span, h, motion, work)
            turns += span < whole
        row, reach = -1, span
        if any_dry and events < MOST_EVENTS:
            row, reach = leaving_row(x, place, span, h, motion, work, alone)
        if row >= 0:
            span = span_to_change(x, row, place, reach, h, motion, alone)
            runge_kutta(x, place, span, h, motion, work)
        if derivatives.n > 1:
            carry(derivatives, x, place, span, h, motion, work)
        for i in range(N_STATES):
            x[i] = end[i]
        if row >= 0:
            change_mode(x, derivatives, row, place + span, motion, alone)
            events += 1
        place += span
