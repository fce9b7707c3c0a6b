"""Unwrapping of absolute encoders sample by sample, for streams and for whole logs.

An encoder at the link side of the gear wraps by whole turns. An encoder in front of the gear may
wrap by several turns of the motor: this period is found at the first jump by whole turns that is at
least as large as the range of the readings so far. If the readings later exceed the period, the
encoder does not wrap, and its readings are used unchanged.

With a known period, each reading is unwrapped to the value closest to a prediction at the latest
speed.
"""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *

TURN = 2.0 * np.pi
NEAR = 4.5  # most sample times between readings for a jump to count as a wrap: three may be lost
PERSISTENT = 3  # readings in a row a quarter turn off the prediction that are real motion
SLACK = 0.01  # turns by which the range of readings may exceed the period

# Indices into the state of an encoder in front of a gear: the last accepted reading and its time,
# the range of readings, the period (0: unknown, negative: the encoder does not wrap), the offset
# subtracted from readings, consecutive odd readings, the number of wraps, and the latest speeds.
SEEN_AT, SEEN, LEAST, MOST, PERIOD, OFFSET, ODD, WRAPPED, NEWEST, SECOND, THIRD = range(11)
N_GEAR = 11


@rounded
def whole_turns(step, turning):
    """Return the whole turns in an encoder's jump between two samples, at the link side.

    Prismatic joints are not `turning` and have none.
    """
    if not turning or abs(step) <= np.pi:
        return 0.0
    turns = np.rint(step / TURN)
    return turns if abs(step - TURN * turns) <= 0.5 * np.pi else 0.0


def first_gear():
    """Return the state before the first reading."""
    gear = np.zeros(N_GEAR)
    gear[[SEEN_AT, SEEN, NEWEST, SECOND, THIRD]] = np.nan
    gear[LEAST], gear[MOST] = np.inf, -np.inf
    return gear


@rounded
def forget_speeds(gear):
    """Discard the latest speeds after an interruption of the motion."""
    for i in range(NEWEST, N_GEAR):
        gear[i] = np.nan


@rounded
def latest_speed(gear):
    """Return the median of the latest three speeds, or the slowest of fewer, in rad per sample.

    One outlier does not change the median.
    """
    if not np.isnan(gear[THIRD]):
        low, high = min(gear[NEWEST], gear[SECOND]), max(gear[NEWEST], gear[SECOND])
        return max(low, min(high, gear[THIRD]))
    if np.isnan(gear[NEWEST]):
        return 0.0
    if np.isnan(gear[SECOND]) or abs(gear[NEWEST]) <= abs(gear[SECOND]):
        return gear[NEWEST]
    return gear[SECOND]


@rounded
def accept_reading(gear, time, reading, turn):
    """Update the state by a reading that is no outlier; return its unwrapped position."""
    gear[ODD] = 0.0
    gear[SEEN_AT], gear[SEEN] = time, reading
    gear[LEAST], gear[MOST] = min(gear[LEAST], reading), max(gear[MOST], reading)
    if gear[PERIOD] > 0.0 and gear[MOST] - gear[LEAST] > gear[PERIOD] + SLACK * turn:
        gear[PERIOD], gear[OFFSET] = -1.0, 0.0
    return reading - gear[OFFSET]


@rounded
def find_period(gear, reading, unexpected, turn):
    """Set the period if the unexpected part of a jump is whole turns that exceed the range."""
    whole = turn * np.rint(abs(unexpected) / turn)
    extent = max(gear[MOST], reading) - min(gear[LEAST], reading)
    is_whole = whole > 0.0 and abs(abs(unexpected) - whole) <= 0.25 * turn
    if is_whole and extent < whole + SLACK * turn:
        gear[PERIOD] = whole


@rounded
def behind_gear(gear, time, reading, turn, sample_time):
    """Return the unwrapped position of a reading in front of a gear; one motor turn is `turn`."""
    samples = (time - gear[SEEN_AT]) / sample_time
    if not 0.0 < samples <= NEAR:
        forget_speeds(gear)
        return accept_reading(gear, time, reading, turn)
    samples = max(1.0, np.rint(samples))
    jump = reading - gear[SEEN]
    expected = latest_speed(gear) * samples
    if gear[PERIOD] == 0.0:
        find_period(gear, reading, jump - expected, turn)
    period = gear[PERIOD] if gear[PERIOD] > 0.0 else turn
    wraps = np.rint((jump - expected) / period) if gear[PERIOD] > 0.0 else 0.0
    step = jump - period * wraps
    is_odd = abs(step - expected) > 0.25 * turn
    if is_odd and not np.isnan(gear[THIRD]) and gear[ODD] + 1.0 < PERSISTENT:
        gear[ODD] += 1.0
        return reading - gear[OFFSET] - period * wraps
    # After two odd readings, a third that fits the prediction may do so by chance.
    is_new = is_odd or gear[ODD] + 1.0 >= PERSISTENT
    if gear[PERIOD] == 0.0 and np.isnan(gear[NEWEST]):
        step -= turn * np.rint(step / turn)  # there may be a wrap between the first two
    if is_new:
        forget_speeds(gear)
    gear[THIRD], gear[SECOND], gear[NEWEST] = gear[SECOND], gear[NEWEST], step / samples
    gear[OFFSET] += period * wraps
    gear[WRAPPED] += abs(wraps)
    return accept_reading(gear, time, reading, turn)


@njit(**equations)
def unwrapped_log(time, readings, turn, turning, sample_time, gear, positions):
    """Unwrap a whole log of one encoder into `positions`; update the state `gear`.

    `turn` is one motor turn at the link side, or 0 for an encoder at the link side. `turning` is
    false for a prismatic joint.
    """
    before, off = np.nan, 0.0
    for n in range(len(readings)):
        reading = readings[n]
        if turn > 0.0:
            reading = behind_gear(gear, time[n], reading, turn, sample_time)
        off += TURN * whole_turns(reading - before, turning)
        before = reading
        positions[n] = reading - off
