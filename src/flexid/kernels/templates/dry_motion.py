"""Motion with set-valued dry friction, and its derivatives, over one sampling interval.

Each row has a mode: the sign of its velocity, 1 or -1, while it slides, and 0 while it sticks. A
change of mode is located within a step. Positions, velocities and the derivatives of positions are
continuous there. The derivatives S of velocities jump:
    reversal   S+ = S- + (a- - a+) t',  t' = -S-/a- of the row that turns,
    sticking   the same equation, so that S+ = 0 in the row that stops; it acts on other rows if the
               mass matrix couples them,
    release    S+ = S-.

The model moves by its own kernel, which this kernel calls by address, so that this kernel is
compiled once for all models. One array, `work`, contains all numbers of a motion.
"""

from collections import namedtuple
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *

MOST_EVENTS = 12  # largest number of changes of mode located within one sampling interval
MOST_TRIALS = 8  # largest number of secant steps that locate a change
CORNER_TRIALS = 3  # number of secant steps that locate a corner
AT_CORNER = 1e-3  # fraction of an interval around a corner that is stepped over
STOPPING_SAMPLES = 3.0  # a row that would stop within this many samples may stick from the start
NEAR = 1e-9  # fraction of an interval to which a change is located
# Smallest acceleration before a reversal, as a fraction of the jump of acceleration. With braking
# friction the acceleration is never below the jump. A fit may try driving friction, with which it
# may be nearly 0: derivatives of the instant of turning would then be huge and useless.
GRAZING = 0.1

# Tasks of a model, and layout of the array `columns`; see the template ``model``.
STEP_STATE, CARRY, RATES, LINEARISE, FIND_CORNERS, FIND_ACTING = range(6)
IN_USE, DELAY, ARE_DRY, AT = range(4)

# A model: its address, its sizes, and the layout of `work`.
Model = namedtuple(
    "Model",
    "address n_states n_rows n_inputs n_coefficients n_constants n_corners n_equations width "
    "z disturbed by_state x step alone drive "
    "modes dry disturbance coefficients constants corners work_size",
)


@uncounted
def clear(first, size, numbers):
    """Set `size` numbers from index `first` on to zero."""
    for i in range(first, first + size):
        numbers[i] = 0.0


@inlined
def move(place, span, h, model, work, columns):
    """Compute the end of a step over a span, a fraction of an interval of h seconds."""
    call(model.address, work, columns, place, span, h, model.x, model.step, STEP_STATE)


@uncounted
def try_move(place, span, h, model, work, columns):
    """Compute the end of a trial step, in a separate part of `work`."""
    size = 6 * model.n_states
    for i in range(size):
        work[model.alone + i] = work[model.step + i]
    move(place, span, h, model, work, columns)
    for i in range(size):
        there = work[model.alone + i]
        work[model.alone + i] = work[model.step + i]
        work[model.step + i] = there


@uncounted
def pull(state, row, side, place, model, work, columns):
    """Acceleration of a row at rest with the friction of sliding in a direction, `side`."""
    mode, rate = model.modes + row, model.alone + model.n_states
    kept = work[mode]
    work[mode] = side
    call(model.address, work, columns, place, 0.0, 0.0, state, rate, RATES)
    work[mode] = kept
    return work[rate + 2 * row + 1]


@uncounted
def margin(state, row, place, model, work, columns):
    """Speed of a sliding row, or reserve of friction of a sticking row: negative ends its mode."""
    mode = work[model.modes + row]
    if mode != 0.0:
        return mode * work[state + 2 * row + 1]
    forward = pull(state, row, 1.0, place, model, work, columns)
    backward = pull(state, row, -1.0, place, model, work, columns)
    return min(-forward, backward)


@uncounted
def change_mode(row, place, model, work, columns):
    """Change the mode of a row whose margin is zero: reverse, stick, or release."""
    x, z, width, n = model.x, model.z, model.width, columns[IN_USE]
    mode, velocity = model.modes + row, 2 * row + 1
    forward = pull(x, row, 1.0, place, model, work, columns)
    backward = pull(x, row, -1.0, place, model, work, columns)
    old = work[mode]
    if old == 0.0:
        work[mode] = 1.0 if forward > -backward else -1.0
        return
    before = forward if old > 0.0 else backward
    after = backward if old > 0.0 else forward
    work[x + velocity] = 0.0
    through = after * old < 0.0
    turned = -old if through else 0.0
    if place == 0.0:  # an observer's correction crossed zero; the instant depends on nothing
        clear(z + velocity * width, n, work)
    elif before * old < 0.0:
        jump = model.alone
        rate = jump + model.n_states
        call(model.address, work, columns, place, 0.0, 0.0, x, jump, RATES)
        work[mode] = turned
        call(model.address, work, columns, place, 0.0, 0.0, x, rate, RATES)
        for i in range(model.n_states):
            work[jump + i] -= work[rate + i]
        least = 0.0
        for i in range(1, 2 * model.n_rows, 2):
            least = max(least, GRAZING * abs(work[jump + i]))
        if abs(before) < least:
            before = -old * least
        for j in range(1, n):
            later = -work[z + velocity * width + j] / before
            for i in range(1, 2 * model.n_rows, 2):
                work[z + i * width + j] += work[jump + i] * later
    work[mode] = turned
    if not through:
        clear(z + velocity * width, n, work)


@uncounted
def first_modes(h, trace, model, work, columns):
    """Set modes at the start of a segment; a row that would stop within a few samples sticks.

    If such a row moves by less than `trace`, its positions do not determine its initial velocity,
    so a fit must not estimate it.
    """
    x, modes, width = model.x, model.modes, model.width
    for row in range(model.n_rows):
        work[modes + row] = -1.0 if work[x + 2 * row + 1] < 0.0 else 1.0
    for row in range(model.n_rows):
        velocity = work[x + 2 * row + 1]
        if work[model.dry + row] == 0.0:
            continue
        forward = pull(x, row, 1.0, 0.0, model, work, columns)
        backward = pull(x, row, -1.0, 0.0, model, work, columns)
        braking = -forward if velocity >= 0.0 else backward
        soon = abs(velocity) <= STOPPING_SAMPLES * h * braking
        near = velocity * velocity <= 2.0 * braking * trace[row]
        if forward <= 0.0 <= backward and soon and near:
            work[modes + row] = 0.0
            work[x + 2 * row + 1] = 0.0
            clear(model.z + (2 * row + 1) * width, width, work)
        elif velocity == 0.0:
            work[modes + row] = 1.0 if forward > -backward else -1.0


@inlined
def leaving_row(place, span, h, model, work, columns):
    """Find the row whose mode ends first, by linear interpolation, and a span within which it ends.

    Return row -1 if no mode ends within the span. `work` must contain the end of the span. A held
    input jumps between two intervals: it may release a row, which may stick again before the
    interval ends.
    """
    x, end = model.x, model.step
    chosen, earliest, reach = -1, 2.0, span
    for row in range(model.n_rows):
        if work[model.dry + row] != 0.0:
            mode = work[model.modes + row]
            last = margin(end, row, place + span, model, work, columns)
            when, within = 2.0, span
            if last < 0.0 or mode == 0.0:
                first = margin(x, row, place, model, work, columns)
                if first < 0.0:
                    when = 0.0
                elif last < 0.0:
                    when = first / (first - last)
            else:
                rise = mode * work[end + model.n_states + 2 * row + 1] * h
                lowest, least = turning_point(row, place, span, last, rise, h, model, work, columns)
                if least < 0.0:
                    first = mode * work[x + 2 * row + 1]
                    when, within = lowest / span * first / (first - least), lowest
            if when < earliest:
                chosen, earliest, reach = row, when, within
    return chosen, reach


@uncounted
def turning_point(row, place, span, last, rise, h, model, work, columns):
    """Find the span after which a sliding row is slowest, and its margin there.

    A row may turn back and forth within one span and slide in the same direction at both ends. A
    parabola through both ends, with the slope at the end, shows whether this is possible. If not,
    the result is the whole span and the margin at its end.
    """
    velocity = 2 * row + 1
    mode = work[model.modes + row]
    first = mode * work[model.x + velocity]
    fall = rise - 2.0 * (last - first) / span
    if first <= 0.0 or rise <= 0.0 or fall <= 0.0 or last >= rise * span:
        return span, last
    fall = -mode * pull(model.x, row, mode, place, model, work, columns) * h
    if fall <= 0.0:
        return span, last
    lowest = span * fall / (fall + rise)
    try_move(place, lowest, h, model, work, columns)
    return lowest, mode * work[model.alone + velocity]


@uncounted
def span_to_change(row, place, span, h, model, work, columns):
    """Find the span after which the margin of a row is zero (Illinois method, regula falsi)."""
    x, end = model.x, model.alone
    low, high = 0.0, span
    at_low = margin(x, row, place, model, work, columns)
    try_move(place, span, h, model, work, columns)
    at_high = margin(end, row, place + span, model, work, columns)
    if at_low <= 0.0:
        side = work[model.modes + row]
        gain = side * pull(x, row, side, place, model, work, columns)
        if side == 0.0 or gain <= 0.0:
            return 0.0
        # The row was just released and comes to rest again: at constant jerk, not before `low`.
        low = 0.5 * span * gain * span * h / (gain * span * h - at_high)
        try_move(place, low, h, model, work, columns)
        at_low = margin(end, row, place + low, model, work, columns)
        if at_low <= 0.0:
            return low
    found = high
    for _ in range(MOST_TRIALS):
        found = low + (high - low) * at_low / (at_low - at_high)
        if found - low < NEAR or high - found < NEAR:
            break
        try_move(place, found, h, model, work, columns)
        value = margin(end, row, place + found, model, work, columns)
        if value < 0.0:
            high, at_high = found, value
            at_low *= 0.5
        else:
            low, at_low = found, value
            at_high *= 0.5
    return found


@inlined
def corners_at(state, target, model, work, columns):
    """Compute the function that is zero at each corner, for one state, into `work`."""
    call(model.address, work, columns, 0.0, 0.0, 0.0, state, target, FIND_CORNERS)


@uncounted
def span_to_corner(place, span, h, model, work, columns):
    """Move up to the first corner of the rates, or over the whole span; return the span.

    The span ends just before the corner, and a short span crosses the corner. All other spans then
    have the slopes of one side in all their stages.
    """
    x, end = model.x, model.step
    before = model.corners
    after = before + model.n_corners
    corners_at(x, before, model, work, columns)
    corners_at(end, after, model, work, columns)
    first, high = -1, span
    for i in range(model.n_corners):
        if work[before + i] * work[after + i] < 0.0:
            when = span * work[before + i] / (work[before + i] - work[after + i])
            if when < high:
                first, high = i, when
    if first < 0:
        return span
    if high <= AT_CORNER:
        move(place, min(span, 2.0 * AT_CORNER), h, model, work, columns)
        return min(span, 2.0 * AT_CORNER)
    low, high, found = 0.0, span, high
    at_low, at_high = work[before + first], work[after + first]
    for _ in range(CORNER_TRIALS):
        found = low + (high - low) * at_low / (at_low - at_high)
        move(place, found, h, model, work, columns)
        corners_at(end, after, model, work, columns)
        value = work[after + first]
        if value * at_low > 0.0:
            low, at_low = found, value
        else:
            high, at_high = found, value
    just_before = max(found - 0.5 * AT_CORNER, 0.5 * AT_CORNER)
    move(place, just_before, h, model, work, columns)
    return just_before


@inlined
def cross_interval(h, substeps, model, work, columns):
    """Advance the state and its derivatives over one sampling interval, in place."""
    x, end = model.x, model.step
    place, events, turns = 0.0, 0, 0
    while place < 1.0 - NEAR:
        span = min(1.0 / substeps, 1.0 - place)
        move(place, span, h, model, work, columns)
        if model.n_corners and turns < MOST_EVENTS:
            whole = span
            span = span_to_corner(place, span, h, model, work, columns)
            turns += span < whole
        row, reach = -1, span
        if columns[ARE_DRY] and events < MOST_EVENTS:
            row, reach = leaving_row(place, span, h, model, work, columns)
        if row >= 0:
            span = span_to_change(row, place, reach, h, model, work, columns)
            move(place, span, h, model, work, columns)
        if columns[IN_USE] > 1:
            call(model.address, work, columns, place, span, h, x, end, CARRY)
        for i in range(model.n_states):
            work[x + i] = work[end + i]
        if row >= 0:
            change_mode(row, place + span, model, work, columns)
            events += 1
        place += span
