"""Checks of a stream's samples before estimation: compiled guard, thresholds and counts."""

from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.kernels.store import load_kernel
from flexid.recording.checks import FEWEST_STILL, MOVED
from flexid.recording.sampling import GAP
from flexid.streaming.options import WatchOptions

GATE = 8.0  # least second difference of an outlier, over the mean of the encoder's others, and
PEAKS = 2.0  # over their peak within a minute: a torque step makes a step of acceleration
STILL_TIME = 0.1  # s for which an encoder may stand still while the other one moves
DEAD_TIME = 5.0  # s for one that has moved less than the other: static friction may hold it
TWISTED = 3.0  # ranges of the deflection, by which the other may move if `MOVED` allows more


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
    """Numbers of samples by their check's result, and of events in a stream."""

    taken: int  # samples used for estimation
    no_number: int  # samples with a value that is not finite or exceeds 1e10
    repeated: int  # samples less than half a sample time after the previous one
    late: int  # samples older than the previous one
    outliers: int  # samples with a position farther from the extrapolated motion than usual
    stuck: int  # samples in which an encoder does not change while the other one moves
    saturated: int  # samples with an input at its limit, so that its true value is unknown
    gaps: int  # places at which samples are missing, by the clock
    missing: int  # samples missing in all gaps
    wraps: int  # wraps of absolute encoders
    restarts: int  # times that the clock was set back
    jumps: int  # positions accepted at another place after at least three unusable samples

    @property
    def fed(self) -> int:
        """Number of all samples."""
        return self.taken + sum(getattr(self, name) for name in _WORDS if name != "missing")

    @property
    def sentence(self) -> str:
        """Summary of all counts, as a sentence for a report."""
        found = {name: getattr(self, name) for name in (*_WORDS, *_EVENTS)}
        bad = ", ".join(f"{found[name]} {words}" for name, words in _WORDS.items() if found[name])
        events = ", ".join(
            f"{found[name]} {word}{'s' if found[name] > 1 else ''}"
            for name, word in _EVENTS.items()
            if found[name]
        )
        more = "".join(f"; {part}" for part in (bad, events) if part)
        return f"Samples: {self.taken} of {self.fed} used{more}"


class Guard:
    """Check of each sample of a stream: its time, positions and inputs."""

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
        """Return the state before the first sample."""
        return self._kernel.first_state(self._n_positions, self._n_inputs)

    def guard(
        self, state: FloatArray, samples: FloatArray
    ) -> tuple[FloatArray, int, FloatArray, int]:
        """Check samples, up to the first that shows a newly stuck encoder.

        Returns the new state, the number of samples checked, the usable ones with NaN where samples
        are missing, (m, n_positions + n_inputs), and for how many samples an encoder is stuck.
        """
        rows = np.empty((2 * len(samples), self._n_positions + self._n_inputs))
        fates = np.empty(len(samples))
        new, judged, filled, still = self._kernel.guard(
            state, samples, self._settings, self._n_positions, rows, fates
        )
        return new, judged, rows[:filled], int(still)

    def counts(self, state: FloatArray) -> Counts:
        """Return the counts so far."""
        found = Counts(*map(int, state[: self._kernel.N_COUNTS]))
        behind_gear = state[self._kernel.GEAR_AT + self._kernel.WRAPPED]
        return replace(found, wraps=found.wraps + int(behind_gear))

    def is_stuck(self, state: FloatArray) -> bool:
        """Return whether an encoder is stuck at the latest sample."""
        return bool(state[self._kernel.STUCK_FOR] > 0.0)

    def time(self, state: FloatArray) -> float:
        """Return the time of the last sample in order, in s; NaN before the first."""
        return float(state[self._kernel.LAST_TIME])
