"""Times of calls for comparisons."""

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
    """Time of one call, from several.

    Parameters
    ----------
    median, minimum : float
        In s.
    repetitions : int
        Number of timed calls.
    """

    median: float
    minimum: float
    repetitions: int

    def per(self, count: int) -> "Timing":
        """Return the timing of one of the `count` equal parts of a call."""
        return Timing(self.median / count, self.minimum / count, self.repetitions)

    @classmethod
    def of(cls, seconds: Sequence[float]) -> "Timing":
        """Return the timing of calls with the given times in s."""
        return cls(float(np.median(seconds)), float(np.min(seconds)), len(seconds))


def measure(
    *calls: Callable[[], object],
    repetitions: int,
    warm_up: int = 1,
    clock: Callable[[], float] = time.perf_counter,
) -> tuple[Timing, ...]:
    """Time calls in turn, so that other work of the machine affects all of them alike.

    Parameters
    ----------
    *calls : callable
        Functions without arguments.
    repetitions : int
        Number of timed rounds.
    warm_up : int, optional
        Number of earlier rounds, for compilation and caches.
    clock : callable, optional
        Clock that is read before and after a call, in s; wall time by default.
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
    """Return the result of one call and its time in s."""
    start = clock()
    result = call()
    return result, clock() - start
