"""Wraps of absolute encoders, undone sample by sample: of a stream's, and of a whole log's.

At the link's side of the gear an encoder wraps by whole turns. In front of a gear it wraps where it
jumps, from one sample to the next, by turns of the motor within which it has stayed so far; from
then on by these. Should it leave them later, it does not wrap, and is taken as it is.

Once it is known by what it wraps, a reading is taken to be the one of all that differ by wraps that
is nearest to where the latest speed leads.
"""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *

TURN = 2.0 * np.pi
NEAR = 3.5  # sample times from one reading to the next within which a jump is a wrap: two are lost
PERSISTENT = 3  # readings in a row that are off by a quarter of a turn: the motor is elsewhere
SLACK = 0.01  # turns by which the range of an encoder may exceed what it wraps by

# Places in the state of an encoder in front of a gear: the last reading that was believed and its
# time, the range of readings, what it wraps by (0: not known, below 0: it does not), what was taken
# off, readings in a row that were odd, wraps, and the latest speeds.
SEEN_AT, SEEN, LEAST, MOST, PERIOD, OFFSET, ODD, WRAPPED, NEWEST, SECOND, THIRD = range(11)
N_GEAR = 11


@rounded
def whole_turns(step, turning):
    """Turns by which an encoder jumped at the link's side, from one sample to the next.

    A joint that slides makes none.
    """
    if not turning or abs(step) <= np.pi:
        return 0.0
    turns = np.rint(step / TURN)
    return turns if abs(step - TURN * turns) <= 0.5 * np.pi else 0.0


def first_gear():
    """State before the first reading."""
    gear = np.zeros(N_GEAR)
    gear[[SEEN_AT, SEEN, NEWEST, SECOND, THIRD]] = np.nan
    gear[LEAST], gear[MOST] = np.inf, -np.inf
    return gear


@rounded
def forget_speeds(gear):
    """Know no speed, where the motion is another."""
    for i in range(NEWEST, N_GEAR):
        gear[i] = np.nan


@rounded
def latest_speed(gear):
    """Median of the latest three, which one outlier does not move; of fewer the slowest; rad each.

    They are counted in samples.
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
def believe_reading(gear, time, reading, turn):
    """The position of a reading that is no outlier."""
    gear[ODD] = 0.0
    gear[SEEN_AT], gear[SEEN] = time, reading
    gear[LEAST], gear[MOST] = min(gear[LEAST], reading), max(gear[MOST], reading)
    if gear[PERIOD] > 0.0 and gear[MOST] - gear[LEAST] > gear[PERIOD] + SLACK * turn:
        gear[PERIOD], gear[OFFSET] = -1.0, 0.0
    return reading - gear[OFFSET]


@rounded
def look_for_period(gear, reading, unexpected, turn):
    """Find what it wraps by, where it jumps by that beside the motion that is expected."""
    whole = turn * np.rint(abs(unexpected) / turn)
    extent = max(gear[MOST], reading) - min(gear[LEAST], reading)
    is_whole = whole > 0.0 and abs(abs(unexpected) - whole) <= 0.25 * turn
    if is_whole and extent < whole + SLACK * turn:
        gear[PERIOD] = whole


@rounded
def behind_gear(gear, time, reading, turn, sample_time):
    """The position of a reading in front of a gear, a turn of whose motor is `turn`."""
    samples = (time - gear[SEEN_AT]) / sample_time
    if not 0.0 < samples <= NEAR:
        forget_speeds(gear)
        return believe_reading(gear, time, reading, turn)
    samples = max(1.0, np.rint(samples))
    jump = reading - gear[SEEN]
    expected = latest_speed(gear) * samples
    if gear[PERIOD] == 0.0:
        look_for_period(gear, reading, jump - expected, turn)
    period = gear[PERIOD] if gear[PERIOD] > 0.0 else turn
    wraps = np.rint((jump - expected) / period) if gear[PERIOD] > 0.0 else 0.0
    step = jump - period * wraps
    is_odd = abs(step - expected) > 0.25 * turn
    if is_odd and not np.isnan(gear[THIRD]) and gear[ODD] + 1.0 < PERSISTENT:
        gear[ODD] += 1.0
        return reading - gear[OFFSET] - period * wraps
    # After two that did not fit, one that does may be where another turn leads.
    is_new = is_odd or gear[ODD] + 1.0 >= PERSISTENT
    if gear[PERIOD] == 0.0 and np.isnan(gear[NEWEST]):
        step -= turn * np.rint(step / turn)  # a wrap may lie between the first two
    if is_new:
        forget_speeds(gear)
    gear[THIRD], gear[SECOND], gear[NEWEST] = gear[SECOND], gear[NEWEST], step / samples
    gear[OFFSET] += period * wraps
    gear[WRAPPED] += abs(wraps)
    return believe_reading(gear, time, reading, turn)


@njit(**equations)
def unwrapped_log(time, readings, turn, turning, sample_time, gear, positions):
    """Fill in the positions of a whole log's encoder, and its state behind a gear of `turn`.

    A `turn` of zero is that of no gear. A joint that is not `turning` slides.
    """
    before, off = np.nan, 0.0
    for n in range(len(readings)):
        reading = readings[n]
        if turn > 0.0:
            reading = behind_gear(gear, time[n], reading, turn, sample_time)
        off += TURN * whole_turns(reading - before, turning)
        before = reading
        positions[n] = reading - off
