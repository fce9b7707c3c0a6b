"""Work on many segments, shared among threads: compiled code that needs no interpreter lock."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

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
    shares = np.linspace(0, total, _SHARES * threads + 1)[1:-1]
    edges = np.unique(np.concatenate(([0], np.searchsorted(reached, shares), [len(lengths)])))
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, edges[:-1].tolist(), edges[1:].tolist()))


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
