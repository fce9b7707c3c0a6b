"""What of a stream may be learnt from: the compiled guard, its thresholds and what it counts."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.kernels.store import load_kernel
from flexid.recording.checks import FEWEST_STILL, MOVED
from flexid.recording.sampling import GAP
from flexid.streaming.options import WatchOptions

GATE = 8.0  # times the mean of an encoder's second differences, from which on it is an outlier
PEAKS = 2.0  # and times their peak in a minute: torque that steps makes accelerations that step
STILL_TIME = 0.1  # seconds for which an encoder may stand still while the other one moves
DEAD_TIME = 5.0  # the same for one that has not yet moved as far as the other: it may be about to
TWISTED = 3.0  # times the range of the deflection so far, by which it may move instead of `MOVED`


_WORDS = {
    "no_number": "without a number",
    "repeated": "repeated",
    "late": "late",
    "outliers": "outliers",
    "stuck": "of a stuck encoder",
    "saturated": "at the input's limit",
    "missing": "missing",
}
_EVENTS = {"gaps": "gap", "wraps": "turn", "jumps": "jump", "restarts": "new clock"}


@dataclass(frozen=True)
class Counts:
    """What happened in a stream."""

    taken: int  # samples that were learnt from
    no_number: int  # something in them is no number, or beyond 1e10
    repeated: int  # they came less than half a sample time after the one before
    late: int  # they are older than the one before
    outliers: int  # a position is off the motion so far, by more than noise and torque ever made
    stuck: int  # an encoder does not change while the other one moves
    saturated: int  # the input rests at its limit, so that it is not known
    gaps: int  # places at which samples are missing, by the clock
    missing: int  # how many are
    wraps: int  # turns that absolute encoders jumped by
    restarts: int  # how often the clock was set back
    jumps: int  # motions that went on elsewhere, after three outliers or other losses in a row

    @property
    def fed(self) -> int:
        """Samples in all."""
        return self.taken + sum(getattr(self, name) for name in _WORDS if name != "missing")

    @property
    def sentence(self) -> str:
        """What became of the samples, in a sentence."""
        found = {name: getattr(self, name) for name in (*_WORDS, *_EVENTS)}
        bad = ", ".join(f"{found[name]} {words}" for name, words in _WORDS.items() if found[name])
        events = ", ".join(
            f"{found[name]} {word}{'s' if found[name] > 1 else ''}"
            for name, word in _EVENTS.items()
            if found[name]
        )
        more = "".join(f"; {part}" for part in (bad, events) if part)
        return f"Samples: {self.taken} of {self.fed} learnt from{more}"


class Guarded(NamedTuple):
    """What the guard says of some samples."""

    state: FloatArray  # the guard's, after them
    judged: int  # how many were: all, or those up to the first at which an encoder is found stuck
    rows: FloatArray  # (m, n_positions + n_inputs): to learn from; NaN where samples are missing
    stuck_for: int  # samples for which that encoder has stood still; 0 if none was found


class Guard:
    """The guard of a stream with a clock."""

    def __init__(self, options: WatchOptions) -> None:
        self._kernel = load_kernel("stream_guard", (), None, ["stream_guard"])
        self._n_positions, self._n_inputs = options.n_encoders, options.n_inputs
        h = options.sample_time
        fewest = (max(FEWEST_STILL, time / h) for time in (STILL_TIME, DEAD_TIME))
        turning = options.joint_type == "revolute"
        self._settings = np.array(
            [
                *(h, GAP, GATE, PEAKS, float(options.from_deflection)),
                *(*fewest, MOVED, TWISTED, options.motor_turn, float(turning)),
            ]
        )

    def first_state(self) -> FloatArray:
        """State before the first sample."""
        return self._kernel.first_state(self._n_positions, self._n_inputs)

    def guard(self, state: FloatArray, samples: FloatArray) -> Guarded:
        """Judge samples, until an encoder is found stuck that was not before."""
        rows = np.empty((2 * len(samples), self._n_positions + self._n_inputs))
        fates = np.empty(len(samples))
        new, judged, filled, still = self._kernel.guard(
            state, samples, self._settings, self._n_positions, rows, fates
        )
        return Guarded(new, judged, rows[:filled], int(still))

    def counts(self, state: FloatArray) -> Counts:
        """What happened so far."""
        found = Counts(*map(int, state[: self._kernel.N_COUNTS]))
        return replace(found, wraps=found.wraps + int(self._kernel.gear_wraps(state)))

    def is_stuck(self, state: FloatArray) -> bool:
        """Whether an encoder stands still at this moment that should not."""
        return bool(state[self._kernel.STUCK_FOR] > 0.0)

    def time(self, state: FloatArray) -> float:
        """Time of the last sample that came in order, in s; NaN before the first."""
        return float(state[self._kernel.LAST_TIME])
