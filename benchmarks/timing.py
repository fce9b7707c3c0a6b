"""Time of calls that are to be compared."""

import gc
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from benchmarks.size import sized

Result = TypeVar("Result")


@dataclass(frozen=True)
class Timing:
    """How long one call took, over several.

    Parameters
    ----------
    median, minimum : float
        In s.
    repetitions : int
        Calls that were timed.
    """

    median: float
    minimum: float
    repetitions: int

    def per(self, count: int) -> "Timing":
        """The same for one of the `count` equal parts of a call."""
        return Timing(self.median / count, self.minimum / count, self.repetitions)

    @classmethod
    def of(cls, seconds: Sequence[float]) -> "Timing":
        """Timing of calls that took so long."""
        return cls(float(np.median(seconds)), float(np.min(seconds)), len(seconds))


def measure(
    *calls: Callable[[], object],
    repetitions: int,
    warm_up: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[Timing, ...]:
    """Time calls in turn, so that whatever else the machine does meets all of them alike.

    Parameters
    ----------
    *calls : callable
        Without arguments.
    repetitions : int
        Rounds that count.
    warm_up : int, optional
        Rounds before, for compilation and caches.
    clock : callable, optional
        What is read before and after a call, in s; wall time by default.
    """
    warm_up, repetitions = sized((warm_up, repetitions), (0, 1))
    rounds = []
    gc.collect()
    gc.disable()
    try:
        for _ in range(warm_up + repetitions):
            rounds.append([timed(call, clock)[1] for call in calls])
    finally:
        gc.enable()
    return tuple(Timing.of([r[place] for r in rounds[warm_up:]]) for place in range(len(calls)))


def timed(
    call: Callable[[], Result], clock: Callable[[], float] = time.perf_counter
) -> tuple[Result, float]:
    """Result of one call and the time in s that it took."""
    start = clock()
    result = call()
    return result, clock() - start
