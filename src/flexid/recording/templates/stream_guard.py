"""Checks of a stream's samples: order in time, gaps, outliers, stuck and saturated channels.

A sample is a time, a position per encoder and the inputs. Each sample gets a fate: taken, or the
reason for its rejection. A row of NaN separates taken samples that are not consecutive; there every
online estimator starts again.
"""

from math import exp
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.recording.templates.encoder_turns import *
    from flexid.recording.templates.limits import *


# Fates of samples.
TAKEN, NO_NUMBER, REPEATED, LATE, OUTLIER, STUCK, SATURATED = 0, 1, 2, 3, 4, 5, 6
# Events that are also counted.
GAPS, MISSING, WRAPS, RESTARTS, JUMPS = 7, 8, 9, 10, 11
N_COUNTS = 12

# Indices into the settings.
SAMPLE_TIME, GAP, GATE, PEAKS, DEFLECTION = 0, 1, 2, 3, 4
STILL_TIME, DEAD_TIME, MOVED, TWISTED, MOTOR_TURN, TURNING = 5, 6, 7, 8, 9, 10

# Indices into the state: counts, the clock, the motor's encoder in front of a gear (see
# `encoder_turns`), then the states of each encoder and of each input.
COUNTS_AT = 0
LAST_TIME, FED, KEPT, SKIPPED, BROKEN, LATE_RUN, LATE_TIME = 12, 13, 14, 15, 16, 17, 18
SCALED, STUCK_FOR, LEAST_TWIST, LARGEST_TWIST = 19, 20, 21, 22
GEAR_AT = 23
ENCODERS_AT = GEAR_AT + N_GEAR
# Indices into an encoder's state: subtracted turns, last raw reading, last two positions, mean and
# peak of second differences, range; samples without a change, and the range of the other encoder
# during these.
TURNS, READING, NEWER, OLDER, MEAN, PEAK, LOWEST, HIGHEST, STILL, FLOOR, CEILING = range(11)
QUANTUM = 11  # smallest change of a reading so far
N_ENCODER = 12

LARGEST = 1e10  # SI: larger values are no measurements; as in `flexid.recording.checks`
LATE_ENOUGH = 20  # consecutive late samples after which the clock was set back
STEPS = 4.0  # encoder steps that are never an outlier, even after a long rest
LEARNING = 20  # second differences needed before a sample can be an outlier
MEAN_TIME, PEAK_TIME = 1.0, 60.0  # s, time constants of the mean and of the peak's decay


def first_state(n_encoders, n_inputs):
    """Return the state before the first sample."""
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
    """Return the index of an encoder's state; the inputs' states follow the last encoder."""
    return ENCODERS_AT + encoder * N_ENCODER


@rounded
def steps_since(state, time, settings):
    """Return whole sample times since the last sample; 0 if repeated, negative if late."""
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
    """Whether the clock was set back: many consecutive late samples in even steps.

    A recorder that is restarted counts from zero again.
    """
    step = (time - state[LATE_TIME]) / settings[SAMPLE_TIME]
    state[LATE_RUN] = state[LATE_RUN] + 1.0 if 0.5 < step < settings[GAP] else 1.0
    state[LATE_TIME] = time
    return state[LATE_RUN] >= LATE_ENOUGH


@rounded
def unwrapped(state, sample, settings, x):
    """Write unwrapped positions into `x`; compute the link position from a deflection."""
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
        # Absolute encoders may start on different turns.
        if turning and j < n - 1 and np.isnan(encoder[READING]):
            encoder[TURNS] = np.rint((sample[1 + j] - x[n - 1]) / TURN)
        x[j] = sample[1 + j] - TURN * encoder[TURNS]


@rounded
def undo_gear(state, sample, settings, n):
    """Unwrap the reading of a motor's encoder in front of a gear, in place."""
    reading = sample[n]
    if settings[MOTOR_TURN] <= 0.0 or not abs(reading) < LARGEST:
        return
    gear = part(state, GEAR_AT, N_GEAR)
    sample[n] = behind_gear(gear, sample[0], reading, settings[MOTOR_TURN], settings[SAMPLE_TIME])


@rounded
def is_outlier(state, x, settings):
    """Whether a position is farther from the line through the last two than ever before.

    Noise and steps of encoders and accelerations of the drive all cause second differences. If
    these are at most d, the position after k samples is within d k (k + 1)/2 of the line.
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
def raise_peak(state, x):
    """Raise the peak of second differences after a real jump, so that it may occur again."""
    k = state[SKIPPED] + 1.0
    for j in range(x.shape[0]):
        encoder = part(state, place_of(j), N_ENCODER)
        off = abs(x[j] - encoder[NEWER] - k * (encoder[NEWER] - encoder[OLDER]))
        if state[KEPT] >= 2.0:
            encoder[PEAK] = max(encoder[PEAK], off / (0.5 * k * (k + 1.0)))


@rounded
def learn_scale(state, x, settings):
    """Update mean and peak of the second differences, the last positions and the ranges."""
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
    if still < 0.5 * settings[STILL_TIME]:  # a stuck encoder would fake a twist
        state[LEAST_TWIST] = min(state[LEAST_TWIST], x[0] - x[last])
        state[LARGEST_TWIST] = max(state[LARGEST_TWIST], x[0] - x[last])


@rounded
def is_stuck(state, sample, x, settings):
    """Whether an encoder is stuck: its reading is constant while the other encoder moves.

    An encoder may rest for STILL_TIME if it has moved before, otherwise for DEAD_TIME. Meanwhile
    the other one must move by a share of its range, or by several times the spring's largest twist.
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
    """Whether an input is at a limit other than zero."""
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
    """Return a sample's fate by its time alone; count gaps and restarts."""
    if not abs(time) < LARGEST:
        state[LAST_TIME] += settings[SAMPLE_TIME]  # assumed to be on time
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
def fate_by_values(state, sample, settings, x):
    """Return the fate of a sample that is in order; write its positions into `x`."""
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
def fate_of(state, sample, settings, x):
    """Return a sample's fate and update the state; write its unwrapped positions into `x`."""
    state[FED] += 1.0
    fate = in_order(state, sample[0], settings)
    if fate in (REPEATED, LATE):  # the stream remains consecutive
        return fate
    if fate == TAKEN:
        undo_gear(state, sample, settings, x.shape[0])
        fate = fate_by_values(state, sample, settings, x)
    if fate != TAKEN:
        state[SKIPPED] += 1.0
        state[BROKEN] = 1.0
        return fate
    if state[SKIPPED] > 0.0:
        if state[SKIPPED] >= PERSISTENT:
            state[COUNTS_AT + JUMPS] += 1.0
            raise_peak(state, x)
        state[KEPT] = 0.0
    learn_scale(state, x, settings)
    state[KEPT] += 1.0
    state[SKIPPED] = 0.0
    return TAKEN


@njit(**equations)
def guard(state, samples, settings, n_encoders, rows, fates):
    """Check samples, up to the first at which an encoder newly counts as stuck.

    Returns the new state, the number of samples checked, the number of rows filled, and for how
    many samples that encoder has been stuck. Rows are positions and inputs of taken samples, or NaN
    where samples are missing.
    """
    new, width = state.copy(), rows.shape[1]
    x, sample = np.empty(n_encoders), np.empty(samples.shape[1])
    filled = 0
    for n in range(samples.shape[0]):
        for i in range(samples.shape[1]):
            sample[i] = samples[n, i]
        fate = fate_of(new, sample, settings, x)
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
