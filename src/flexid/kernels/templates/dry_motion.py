"""Motion with set-valued dry friction, and its derivatives, over one sampling interval.

Each row has a mode: 1 or -1 while it slides, which is the sign of its velocity, and 0 while it
sticks. A change of mode is located within a step; positions and velocities are continuous there,
and so are their derivatives, but for those of velocities:
    reversal   S+ = S- + (a- - a+) t',  t' = -S-/a- of the row that turns,
    sticking   the same, so that S+ = 0 in the row that stops; the others feel it stop if the mass
               matrix couples them,
    release    S+ = S-.

The model is moved by its own kernel, which this one calls by its address, so that this one is
compiled once for all models. All numbers of a motion lie in one array, `work`.
"""

from collections import namedtuple
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *

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

# What a model does, and what is where in the array `columns`; see the template ``model``.
STEP_STATE, CARRY, RATES, LINEARISE, FIND_CORNERS = range(5)
IN_USE, DELAY, ARE_DRY, AT = range(4)

# A model: its address, its sizes, and what lies where in `work`.
Model = namedtuple(
    "Model",
    "address n_states n_rows n_inputs n_coefficients n_constants n_corners n_equations width "
    "z disturbed by_state x step alone drive "
    "modes dry disturbance coefficients constants corners work_size",
)


@uncounted
def clear(first, size, numbers):
    """Let so many numbers be zero."""
    for i in range(first, first + size):
        numbers[i] = 0.0


@uncounted
def start_derivatives(model, work):
    """Let the derivatives be those at the start of a segment."""
    width = model.width
    clear(model.z, model.n_states * width, work)
    clear(model.disturbed, model.n_rows * width, work)
    for i in range(model.n_states):
        work[model.z + i * width + 1 + i] = 1.0


@uncounted
def move(place, span, h, model, work, columns):
    """Bring the state over a span of an interval of h seconds."""
    call(model.address, work, columns, place, span, h, model.x, model.step, STEP_STATE)


@uncounted
def try_move(place, span, h, model, work, columns):
    """The same for a look ahead, into another place."""
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
    """Acceleration of a row at rest if its friction were that of sliding to a side."""
    mode, rate = model.modes + row, model.alone + model.n_states
    kept = work[mode]
    work[mode] = side
    call(model.address, work, columns, place, 0.0, 0.0, state, rate, RATES)
    work[mode] = kept
    return work[rate + 2 * row + 1]


@uncounted
def margin(state, row, place, model, work, columns):
    """Positive as long as a row stays in its mode: its speed, or what friction has in reserve."""
    mode = work[model.modes + row]
    if mode != 0.0:
        return mode * work[state + 2 * row + 1]
    forward = pull(state, row, 1.0, place, model, work, columns)
    backward = pull(state, row, -1.0, place, model, work, columns)
    return min(-forward, backward)


@uncounted
def change_mode(row, place, model, work, columns):
    """Let a row whose margin is used up change its mode: reverse, stick, or let go."""
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
    if place == 0.0:  # an observer's correction took it beyond zero, at a time that nothing moves
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
    """Modes at the start of a segment; a row that would stop within a few samples sticks at once.

    How fast such a row was leaves no trace in its positions, if it moves by less than `trace`, and
    a fit must not chase it.
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


@uncounted
def leaving_row(place, span, h, model, work, columns):
    """The row whose mode ends first, by linear interpolation, and a span within which it does.

    It is -1 where none ends within the span that `work` holds the end of. A held input jumps
    between two intervals: it may let go of a row that stuck, and hold it again before the interval
    ends.
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
    """Span after which a row that slides is slowest, and its margin there.

    A row may turn back and forth within one span and slide at its end as it did at its start; the
    margin is that of the end where it cannot have done so, by a parabola through both ends with
    the slope at the end.
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
    """Span after which the margin of a row is used up (regula falsi after Illinois)."""
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
        # It has just been let go and comes to rest again: at constant jerk, not before this.
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


@uncounted
def corners_at(state, target, model, work, columns):
    """Put what is zero at each corner, for one state, into `work`."""
    call(model.address, work, columns, 0.0, 0.0, 0.0, state, target, FIND_CORNERS)


@uncounted
def span_to_corner(place, span, h, model, work, columns):
    """Span up to the first corner of the rates, or all of it; the work holds the end of that.

    It ends just before the corner, and the next span just behind: each of the others then has the
    slopes of one side in all its stages.
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


@uncounted
def cross_interval(h, substeps, model, work, columns):
    """Bring the state and its derivatives over one sampling interval, in place."""
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
