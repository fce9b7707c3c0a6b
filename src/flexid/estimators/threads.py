"""Work on many segments, shared among threads: compiled code that needs no interpreter lock."""

import os
from collections.abc import Callable
from itertools import pairwise
from threading import Thread

import numpy as np
from numpy.typing import NDArray

_FEWEST_SAMPLES = 5_000  # of a thread: below, starting it costs as much as it saves
_SHARES = 4  # of each thread, so that none waits long for another


def in_threads(
    run: Callable[[int, int], None],
    lengths: NDArray[np.int64],  # (n_segments,)
) -> None:
    """Call a function for ranges of segments, on all cores if there is enough to do."""
    reached = np.cumsum(lengths)
    total = int(reached[-1])
    threads = min(cores(), total // _FEWEST_SAMPLES, len(lengths))
    if threads < 2:
        run(0, len(lengths))
        return
    shares = total * np.arange(1, _SHARES * threads) / (_SHARES * threads)
    edges = sorted({0, *np.searchsorted(reached, shares).tolist(), len(lengths)})
    left = iter(list(pairwise(edges)))  # all threads take from it what comes next
    failed: list[Exception] = []

    def work() -> None:
        try:
            for first, stop in left:
                run(first, stop)
        except Exception as error:
            failed.append(error)

    helpers = [Thread(target=work) for _ in range(threads - 1)]
    for helper in helpers:
        helper.start()
    work()
    for helper in helpers:
        helper.join()
    if failed:
        raise failed[0]


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
