"""Wraps of an encoder in front of a gear, undone sample by sample, by the rules of a log's.

`flexid.recording.checks.unwrap` looks at a whole log first. Beside a drive an encoder wraps where
it jumps, from one sample to the next, by turns of the motor within which it has stayed so far; from
then on by these. Should it leave them later, it does not wrap, and is taken as it is.
"""

from math import isnan

from flexid.arrays import FloatArray

NEAR = 3.5
"""Sample times from one reading to the next within which a jump is a wrap: two may be lost."""

PERSISTENT = 3
"""Readings in a row that are off by a quarter of a turn: no outliers, the motor is elsewhere."""

LATE_ENOUGH = 20
"""Readings that are late in a row: the clock was set back."""

_LARGEST = 1e10  # rad: what is larger is no reading
_SLACK = 0.01  # turns by which the range of an encoder may exceed what it wraps by
_NAMES = ("time", "reading", "lowest", "highest", "period", "offset", "wraps", "late", "odd")


class GearWraps:
    """The encoder in front of a gear.

    Parameters
    ----------
    turn : float
        A turn of the motor at the link's side, in rad; 0 where there is no such encoder.
    sample_time : float
        In s.
    column : int
        Of a sample, in which it stands.
    """

    def __init__(self, turn: float, sample_time: float, column: int) -> None:
        self._turn, self._near, self._column = turn, NEAR * sample_time, column
        self._time = float("nan")
        self._reading = float("nan")
        self._lowest, self._highest = float("inf"), float("-inf")
        self._period = 0.0  # what it wraps by; below 0: it does not
        self._offset = 0.0
        self._wraps = self._late = self._odd = 0.0

    @property
    def wraps(self) -> int:
        """How often it has wrapped."""
        return int(self._wraps)

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
        is_odd = False
        if 0.0 < time - self._time <= self._near:
            self._look_for_wrap(reading)
            jump = abs(reading - self._reading)
            is_odd = jump > 0.25 * self._turn and not self._is_whole(jump)
        self._late = 0.0
        self._odd = self._odd + 1.0 if is_odd else 0.0
        if is_odd and self._odd < PERSISTENT:
            return reading - self._offset
        self._time, self._reading = time, reading
        self._lowest = min(self._lowest, reading)
        self._highest = max(self._highest, reading)
        if self._highest - self._lowest > self._period + _SLACK * self._turn and self._period > 0.0:
            self._period, self._offset = -1.0, 0.0
        return reading - self._offset

    def _look_for_wrap(self, reading: float) -> None:
        jump = reading - self._reading
        if self._period == 0.0:
            turns = round(abs(jump) / self._turn)
            extent = max(self._highest, reading) - min(self._lowest, reading)
            whole = turns * self._turn
            if (
                turns >= 1
                and abs(abs(jump) - whole) <= 0.25 * self._turn
                and extent < whole + _SLACK * self._turn
            ):
                self._period = whole
        if self._is_whole(abs(jump)):
            self._offset += self._period if jump > 0.0 else -self._period
            self._wraps += 1.0

    def _is_whole(self, jump: float) -> bool:
        """Whether a jump is a wrap."""
        return self._period > 0.0 and abs(jump - self._period) <= 0.25 * self._turn
