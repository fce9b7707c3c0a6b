"""What may be learnt from of a stream: samples in order, without gaps, outliers and dead sensors.

A sample is time, a position per encoder and the inputs. What is wrong with it is its fate; wherever
the ones that are left do not follow each other, a row without numbers stands between them, at which
every online estimator begins again.
"""

from math import exp
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.recording.templates.encoder_turns import *
    from flexid.recording.templates.limits import *


# What became of a sample.
TAKEN, NO_NUMBER, REPEATED, LATE, OUTLIER, STUCK, SATURATED = 0, 1, 2, 3, 4, 5, 6
# What happened on the way, counted beside the fates.
GAPS, MISSING, WRAPS, RESTARTS, JUMPS = 7, 8, 9, 10, 11
N_COUNTS = 12

# Places in the settings.
SAMPLE_TIME, GAP, GATE, PEAKS, DEFLECTION = 0, 1, 2, 3, 4
STILL_TIME, DEAD_TIME, MOVED, TWISTED, MOTOR_TURN, TURNING = 5, 6, 7, 8, 9, 10

# Places in the state: counts, the clock, what is known of the motor's encoder in front of a gear,
# then of each encoder and of each input.
COUNTS_AT = 0
LAST_TIME, FED, KEPT, SKIPPED, BROKEN, LATE_RUN, LATE_TIME = 12, 13, 14, 15, 16, 17, 18
SCALED, STUCK_FOR, LEAST_TWIST, LARGEST_TWIST = 19, 20, 21, 22
GEAR_AT = 23
ENCODERS_AT = GEAR_AT + N_GEAR
# Of an encoder: turns taken off, last readings as they came and as they were kept, mean and peak
# of second differences, range; since when it stands still, and the other one's range since then.
TURNS, READING, NEWER, OLDER, MEAN, PEAK, LOWEST, HIGHEST, STILL, FLOOR, CEILING = range(11)
QUANTUM = 11  # smallest change of a reading so far
N_ENCODER = 12

LARGEST = 1e10  # in SI: what is larger is no measurement; as in `flexid.recording.checks`
LATE_ENOUGH = 20  # samples that are late in a row: the clock was set back
STEPS = 4.0  # of an encoder that are no outlier, however long it has stood still
LEARNING = 20  # second differences before any is called an outlier
MEAN_TIME, PEAK_TIME = 1.0, 60.0  # s over which mean and peak fade


def first_state(n_encoders, n_inputs):
    """State before the first sample."""
    inputs_at = ENCODERS_AT + n_encoders * N_ENCODER
    state = np.zeros(inputs_at + 2 * n_inputs * N_END)
    state[[LAST_TIME, LATE_TIME]] = np.nan
    state[LEAST_TWIST], state[LARGEST_TWIST] = np.inf, -np.inf
    state[GEAR_AT:ENCODERS_AT] = first_gear()
    encoders = state[ENCODERS_AT:inputs_at].reshape(n_encoders, N_ENCODER)
    encoders[:, READING] = np.nan
    encoders[:, [LOWEST, FLOOR, QUANTUM]] = np.inf
    encoders[:, [HIGHEST, CEILING]] = -np.inf
    state[inputs_at:].reshape(2 * n_inputs, N_END)[:, [LEVEL, BESIDE]] = -np.inf
    return state


@rounded
def place_of(encoder):
    """Where in the state an encoder begins; the inputs follow the last one."""
    return ENCODERS_AT + encoder * N_ENCODER


@rounded
def steps_since(state, time, settings):
    """Whole samples from the last one to this; 0 where it repeats, negative where it is late."""
    last = state[LAST_TIME]
    if not abs(last) < np.inf:
        return 1.0
    steps = (time - last) / settings[SAMPLE_TIME]
    if steps <= 0.0:
        return -1.0 if steps < 0.0 else 0.0
    if steps < settings[GAP]:
        return 0.0 if steps < 0.5 else 1.0
    return np.rint(steps)


@rounded
def set_back(state, time, settings):
    """Whether samples have been late, evenly and in order, for so long that the clock is another's.

    Recorders that are started again count from zero again.
    """
    step = (time - state[LATE_TIME]) / settings[SAMPLE_TIME]
    state[LATE_RUN] = state[LATE_RUN] + 1.0 if 0.5 < step < settings[GAP] else 1.0
    state[LATE_TIME] = time
    return state[LATE_RUN] >= LATE_ENOUGH


@rounded
def unwrapped(state, sample, settings, x):
    """Positions without the turns that absolute encoders jump by; links from deflections."""
    n, turning = x.shape[0], settings[TURNING] != 0.0
    for back in range(n):
        j = n - 1 - back
        encoder = part(state, place_of(j), N_ENCODER)
        if settings[DEFLECTION] != 0.0 and j == 0:
            x[j] = x[1] + sample[1]
            continue
        turns = 0.0
        if state[SKIPPED] < PERSISTENT:
            turns = whole_turns(sample[1 + j] - encoder[READING], turning)
        if turns != 0.0:
            encoder[TURNS] += turns
            state[COUNTS_AT + WRAPS] += 1.0
            encoder[READING] = sample[1 + j]
        # Where encoders begin is not known.
        if turning and j < n - 1 and np.isnan(encoder[READING]):
            encoder[TURNS] = np.rint((sample[1 + j] - x[n - 1]) / TURN)
        x[j] = sample[1 + j] - TURN * encoder[TURNS]


@rounded
def undo_gear(state, sample, settings, n):
    """Undo the wraps of the motor's encoder in front of a gear, in the sample."""
    reading = sample[n]
    if settings[MOTOR_TURN] <= 0.0 or not abs(reading) < LARGEST:
        return
    gear = part(state, GEAR_AT, N_GEAR)
    sample[n] = behind_gear(gear, sample[0], reading, settings[MOTOR_TURN], settings[SAMPLE_TIME])


@rounded
def is_outlier(state, x, settings):
    """Whether a position is off the straight line through the last two, more than ever before.

    Encoders' noise, their steps and the drive's accelerations all make second differences. Over k
    samples a motion whose second differences are within d is within d k (k + 1)/2 of the line.
    """
    if state[KEPT] < 2.0 or state[SCALED] < LEARNING:
        return False
    k = state[SKIPPED] + 1.0
    for j in range(x.shape[0]):
        encoder = part(state, place_of(j), N_ENCODER)
        off = abs(x[j] - encoder[NEWER] - k * (encoder[NEWER] - encoder[OLDER]))
        usual = max(settings[GATE] * encoder[MEAN], settings[PEAKS] * encoder[PEAK])
        if encoder[QUANTUM] < np.inf:
            usual = max(usual, STEPS * encoder[QUANTUM])
        if off > usual * 0.5 * k * (k + 1.0):
            return True
    return False


@rounded
def believe(state, x):
    """Take for the peak what a motion must have done that went on elsewhere: it may again."""
    k = state[SKIPPED] + 1.0
    for j in range(x.shape[0]):
        encoder = part(state, place_of(j), N_ENCODER)
        off = abs(x[j] - encoder[NEWER] - k * (encoder[NEWER] - encoder[OLDER]))
        if state[KEPT] >= 2.0:
            encoder[PEAK] = max(encoder[PEAK], off / (0.5 * k * (k + 1.0)))


@rounded
def learn_scale(state, x, settings):
    """Take the positions' second differences into their mean and peak, and keep the positions."""
    counts = state[KEPT] >= 2.0 and state[SKIPPED] == 0.0
    h = settings[SAMPLE_TIME]
    if counts:
        state[SCALED] += 1.0
    weight = max(1.0 / max(state[SCALED], 1.0), 1.0 - exp(-h / MEAN_TIME))
    for j in range(x.shape[0]):
        encoder = part(state, place_of(j), N_ENCODER)
        if counts:
            size = abs(x[j] - 2.0 * encoder[NEWER] + encoder[OLDER])
            encoder[MEAN] += weight * (size - encoder[MEAN])
            encoder[PEAK] = max(size, encoder[PEAK] * exp(-h / PEAK_TIME))
        encoder[OLDER] = encoder[NEWER]
        encoder[NEWER] = x[j]
        encoder[LOWEST] = min(encoder[LOWEST], x[j])
        encoder[HIGHEST] = max(encoder[HIGHEST], x[j])
    last = x.shape[0] - 1
    still = max(state[place_of(0) + STILL], state[place_of(last) + STILL])
    if still < 0.5 * settings[STILL_TIME]:  # one that is stuck would stretch the spring for ever
        state[LEAST_TWIST] = min(state[LEAST_TWIST], x[0] - x[last])
        state[LARGEST_TWIST] = max(state[LARGEST_TWIST], x[0] - x[last])


@rounded
def is_stuck(state, sample, x, settings):
    """Whether an encoder has not changed while the other one moved: `STUCK` or not.

    One that has moved before may stand for STILL_TIME; one that never moved, for DEAD_TIME. The
    other has to move meanwhile by a share of its range, or by several times what the spring gave.
    """
    stuck, n = False, x.shape[0]
    twist = settings[TWISTED] * max(state[LARGEST_TWIST] - state[LEAST_TWIST], 0.0)
    for j in range(x.shape[0]):
        encoder = part(state, place_of(j), N_ENCODER)
        other = part(state, place_of(n - 1 - j), N_ENCODER)
        reading, place = sample[1 + j], x[n - 1 - j]
        if settings[DEFLECTION] != 0.0 and j == 1:  # the link was computed from the motor
            place = sample[1]
        if reading != encoder[READING]:
            change = abs(reading - encoder[READING])
            if change < encoder[QUANTUM]:
                encoder[QUANTUM] = change
            encoder[READING] = reading
            encoder[STILL] = 0.0
            encoder[FLOOR], encoder[CEILING] = place, place
            continue
        encoder[STILL] += 1.0
        encoder[FLOOR] = min(encoder[FLOOR], place)
        encoder[CEILING] = max(encoder[CEILING], place)
        if n < 2 or settings[DEFLECTION] != 0.0:
            continue
        moved = encoder[CEILING] - encoder[FLOOR]
        own = encoder[HIGHEST] - encoder[LOWEST]
        allowed = settings[STILL_TIME] if own > moved else settings[DEAD_TIME]
        enough = moved > min(settings[MOVED] * (other[HIGHEST] - other[LOWEST]), twist)
        stuck = stuck or (enough and moved > 0.0 and encoder[STILL] >= allowed)
    return stuck


@rounded
def is_saturated(state, sample, n):
    """Whether an input stands at a limit; one that is switched off does not."""
    found = False
    for i in range(sample.shape[0] - 1 - n):
        value = sample[1 + n + i]
        first = place_of(n) + 2 * i * N_END
        at_upper = at_limit(part(state, first, N_END), value)
        at_lower = at_limit(part(state, first + N_END, N_END), -value)
        found = found or ((at_upper or at_lower) and value != 0.0)
    return found


@rounded
def in_order(state, time, settings):
    """Fate of a sample by its time alone; gaps are counted, and followed by a new beginning."""
    if not abs(time) < LARGEST:
        state[LAST_TIME] += settings[SAMPLE_TIME]  # it came when the next one was due
        return NO_NUMBER
    steps = steps_since(state, time, settings)
    if steps == 0.0:
        return REPEATED
    if steps < 0.0:
        if not set_back(state, time, settings):
            return LATE
        state[COUNTS_AT + RESTARTS] += 1.0
        state[KEPT], state[SKIPPED], state[BROKEN] = 0.0, 0.0, 1.0
    elif steps > 1.0:
        state[COUNTS_AT + GAPS] += 1.0
        state[COUNTS_AT + MISSING] += steps - 1.0
        state[KEPT], state[SKIPPED], state[BROKEN] = 0.0, 0.0, 1.0
    state[LAST_TIME] = time
    state[LATE_RUN] = 0.0
    return TAKEN


@rounded
def judged(state, sample, settings, x):
    """Fate of a sample that came in order; its positions go into x."""
    for value in sample:
        if not abs(value) < LARGEST:
            return NO_NUMBER
    unwrapped(state, sample, settings, x)
    if state[SKIPPED] < PERSISTENT and is_outlier(state, x, settings):
        return OUTLIER
    if is_stuck(state, sample, x, settings):
        return STUCK
    if is_saturated(state, sample, x.shape[0]):
        return SATURATED
    return TAKEN


@rounded
def look(state, sample, settings, x):
    """Fate of a sample, from which wraps are taken off; its positions go into x."""
    state[FED] += 1.0
    fate = in_order(state, sample[0], settings)
    if fate in (REPEATED, LATE):  # nothing is missing for that
        return fate
    if fate == TAKEN:
        undo_gear(state, sample, settings, x.shape[0])
        fate = judged(state, sample, settings, x)
    if fate != TAKEN:
        state[SKIPPED] += 1.0
        state[BROKEN] = 1.0
        return fate
    if state[SKIPPED] > 0.0:
        if state[SKIPPED] >= PERSISTENT:
            state[COUNTS_AT + JUMPS] += 1.0
            believe(state, x)
        state[KEPT] = 0.0
    learn_scale(state, x, settings)
    state[KEPT] += 1.0
    state[SKIPPED] = 0.0
    return TAKEN


@njit(**equations)
def guard(state, samples, settings, n_encoders, rows, fates):
    """Judge samples, until an encoder is found stuck that was not before.

    Returns the new state, how many samples were judged, how many rows were filled with positions
    and inputs of what may be learnt from, and for how long that encoder has stood still, in
    samples. A row without numbers stands for what is missing.
    """
    new, width = state.copy(), rows.shape[1]
    x, sample = np.empty(n_encoders), np.empty(samples.shape[1])
    filled = 0
    for n in range(samples.shape[0]):
        for i in range(samples.shape[1]):
            sample[i] = samples[n, i]
        fate = look(new, sample, settings, x)
        fates[n] = fate
        new[COUNTS_AT + fate] += 1.0
        if fate == STUCK and new[STUCK_FOR] == 0.0:
            for j in range(x.shape[0]):
                new[STUCK_FOR] = max(new[STUCK_FOR], new[place_of(j) + STILL])
            return new, n + 1, filled, new[STUCK_FOR]
        if fate != TAKEN:
            continue
        new[STUCK_FOR] = 0.0
        if new[BROKEN] != 0.0:
            for i in range(width):
                rows[filled, i] = np.nan
            new[BROKEN] = 0.0
            filled += 1
        for i in range(width):
            rows[filled, i] = x[i] if i < n_encoders else sample[1 + i]
        filled += 1
    return new, samples.shape[0], filled, 0.0


def gear_wraps(state):
    """How often the motor's encoder wrapped in front of a gear."""
    return state[GEAR_AT + WRAPPED]
