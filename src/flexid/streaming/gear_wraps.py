"""Wraps of an encoder in front of a gear, undone sample by sample, by the rules of a log's.

`flexid.recording.checks.unwrap` looks at a whole log first. Beside a drive an encoder wraps where
it jumps, from one sample to the next, by turns of the motor within which it has stayed so far; from
then on by these. Should it leave them later, it does not wrap, and is taken as it is.

Once it is known by what it wraps, a reading is taken to be the one of all that differ by wraps that
is nearest to where the latest speed leads. Where that cannot be known, the nearest to the reading
before is taken, and it is counted.
"""

from math import isnan, nan

from flexid.arrays import FloatArray

NEAR = 3.5
"""Sample times from one reading to the next within which a jump is a wrap: two may be lost."""

SAME = 0.5
"""Sample times within which a reading says no speed: the guard takes it for a repeated one."""

PERSISTENT = 3
"""Readings in a row that are off by a quarter of a turn: no outliers, the motor is elsewhere."""

LATE_ENOUGH = 20  # readings that are late in a row: the clock was set back
_LARGEST = 1e10  # rad: what is larger is no reading
_UNCLEAR = 0.25  # of what it wraps by, off the speed: it could as well be another wrap
_SLACK = 0.01  # turns by which the range of an encoder may exceed what it wraps by
_NAMES = ("time", "reading", "lowest", "highest", "period", "offset", "wraps", "late", "odd")
_NAMES += ("unclear", "newest", "newer", "oldest")


class GearWraps:
    """The encoder in front of a gear."""

    def __init__(self, turn: float, sample_time: float, column: int) -> None:
        self._turn, self._sample_time, self._column = turn, sample_time, column
        self._time = nan
        self._reading = nan
        self._lowest, self._highest = float("inf"), float("-inf")
        self._period = 0.0  # what it wraps by; below 0: it does not
        self._offset = 0.0
        self._wraps = self._late = self._odd = self._unclear = 0.0
        self._newest = self._newer = self._oldest = nan  # the latest speeds, in rad in a sample

    @property
    def wraps(self) -> int:
        """How often it has wrapped."""
        return int(self._wraps)

    @property
    def unclear(self) -> int:
        """How often it cannot be known by how many wraps it moved; 0 while it does not wrap."""
        return int(self._unclear) if self._period > 0.0 else 0

    @property
    def state(self) -> list[float]:
        """All that is carried from sample to sample."""
        return [getattr(self, f"_{name}") for name in _NAMES]

    @state.setter
    def state(self, values: list[float]) -> None:
        for name, value in zip(_NAMES, values, strict=True):
            setattr(self, f"_{name}", float(value))

    def undone(self, samples: FloatArray) -> FloatArray:
        """Samples without the wraps, shape (n, n_values); they are not changed."""
        if not self._turn:
            return samples
        found = samples.copy()
        readings = zip(samples[:, 0].tolist(), samples[:, self._column].tolist(), strict=True)
        found[:, self._column] = [self._one(time, reading) for time, reading in readings]
        return found

    def _one(self, time: float, reading: float) -> float:
        if not abs(reading) < _LARGEST or isnan(time):
            return reading - self._offset
        if time <= self._time:
            self._late += 1.0
            if self._late < LATE_ENOUGH:
                return reading - self._offset
        self._late = 0.0
        samples = (time - self._time) / self._sample_time
        if 0.0 < samples < SAME:
            return reading - self._offset - self._moved_by(reading - self._reading, 0.0)
        if 0.0 < samples <= NEAR:
            return self._next(time, reading, max(1.0, float(round(samples))))
        if not isnan(self._time):
            self._unclear += 1.0
        self._forget_speed()
        return self._accept(time, reading)

    def _next(self, time: float, reading: float, samples: float) -> float:
        """A reading so many samples after the last one."""
        jump = reading - self._reading
        expected = self._speed * samples
        if self._period == 0.0:
            self._look_for_wrap(reading, jump - expected)
        wrapped = self._moved_by(jump, expected)
        by = self._period if self._period > 0.0 else self._turn
        off = abs(jump - wrapped - expected)
        is_odd = off > 0.25 * self._turn
        if is_odd and not isnan(self._oldest) and self._odd + 1.0 < PERSISTENT:
            self._odd += 1.0
            return reading - self._offset - wrapped
        # After two that did not fit, one that does may be where another turn leads.
        is_new = is_odd or self._odd + 1.0 >= PERSISTENT
        if off > _UNCLEAR * by or (is_new and self._odd > 0.0):
            self._unclear += 1.0
        step = jump - wrapped
        if self._period == 0.0 and isnan(self._newest):
            step -= self._turn * round(step / self._turn)  # a wrap may lie between the first two
        if is_new:
            self._forget_speed()
        self._newest, self._newer, self._oldest = step / samples, self._newest, self._newer
        self._offset += wrapped
        self._wraps += abs(round(wrapped / by))
        return self._accept(time, reading)

    def _accept(self, time: float, reading: float) -> float:
        self._odd = 0.0
        self._time, self._reading = time, reading
        self._lowest = min(self._lowest, reading)
        self._highest = max(self._highest, reading)
        if self._highest - self._lowest > self._period + _SLACK * self._turn and self._period > 0.0:
            self._period, self._offset = -1.0, 0.0
        return reading - self._offset

    @property
    def _speed(self) -> float:
        """Median of the latest three, which one outlier does not move; of fewer the slowest."""
        known = [v for v in (self._newest, self._newer, self._oldest) if not isnan(v)]
        return sorted(known)[1] if len(known) == 3 else min(known, key=abs, default=0.0)

    def _forget_speed(self) -> None:
        self._newest = self._newer = self._oldest = nan

    def _moved_by(self, jump: float, expected: float) -> float:
        """What of a jump is wraps."""
        return self._period * round((jump - expected) / self._period) if self._period > 0.0 else 0.0

    def _look_for_wrap(self, reading: float, unexpected: float) -> None:
        """Find what it wraps by, where it jumps by that beside the motion that is expected."""
        turns = round(abs(unexpected) / self._turn)
        extent = max(self._highest, reading) - min(self._lowest, reading)
        whole = turns * self._turn
        if (
            turns >= 1
            and abs(abs(unexpected) - whole) <= 0.25 * self._turn
            and extent < whole + _SLACK * self._turn
        ):
            self._period = whole
