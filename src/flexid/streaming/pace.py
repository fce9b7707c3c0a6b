"""When the samples of a log that is played again are due: as they came, but for jumps of its clock.

One sample stamped an hour ahead must not hold up the rest for an hour, nor must what follows it
come all at once.
"""

from itertools import pairwise

import numpy as np

from flexid.arrays import FloatArray

LONGEST_WAIT = 1.0
"""Seconds that are waited for one sample at most; beyond the longest sample time of a drive."""


class Pace:
    """Due times of samples, block by block.

    Time stamps run on where each is within `LONGEST_WAIT` of the one before; in such a run, what is
    late comes with what was before it. A jump ahead takes `LONGEST_WAIT`, a jump back no time, and
    one that leads back to the run before, from a few stamps of another time, neither.
    """

    def __init__(self) -> None:
        self.jumps = 0  # times at which the clock jumped ahead by more than is waited for
        self._time = np.nan  # stamp of the last sample
        self._due = 0.0  # when that is
        self._first = (0.0, 0.0)  # stamp and due of this run's first sample
        self._left: tuple[float, float, tuple[float, float]] | None = None  # all before the jump

    def due(self, times: FloatArray) -> FloatArray:
        """When the next samples are due, in s after the first of all; never less than before."""
        if np.isnan(self._time):
            self._time = float(times[0])
            self._first = (self._time, 0.0)
        found = np.empty(len(times))
        with np.errstate(over="ignore"):
            jumps = np.flatnonzero(np.abs(np.diff(times, prepend=self._time)) > LONGEST_WAIT)
        for start, stop in pairwise((-1, *jumps.tolist(), len(times))):
            if start >= 0:
                self._jump(float(times[start]))
            first = max(start, 0)
            if first == stop:  # the block begins with a jump
                continue
            stamp, due = self._first
            run = np.maximum(times[first:stop] - stamp + due, self._due)
            found[first:stop] = np.maximum.accumulate(run)
            self._due, self._time = float(found[stop - 1]), float(times[stop - 1])
        return found

    def _jump(self, to: float) -> None:
        """Begin another run, or go on with the one before."""
        left, self._left = self._left, (self._time, self._due, self._first)
        is_short = left is not None and self._due - left[1] <= 2.0 * LONGEST_WAIT
        if left is not None and is_short and abs(to - left[0]) <= LONGEST_WAIT:
            self._first = left[2]
            return
        ahead = to > self._time
        self.jumps += ahead
        self._first = (to, self._due + LONGEST_WAIT * ahead)
