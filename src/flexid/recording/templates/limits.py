"""Detection of limits of sensors and inputs sample by sample, for streams and whole logs."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *

# Indices into the state of a signal's upper end: largest value, samples there, visits, consecutive
# samples there; the second largest value and the samples there.
LEVEL, HITS, OCCASIONS, RUN, BESIDE, BESIDE_HITS = range(6)
N_END = 6


@rounded
def is_limit(end):
    """Whether a signal is limited: it visits its largest value repeatedly and for long.

    A free signal has about as many samples at its second largest value.
    """
    rests = end[OCCASIONS] >= 2.0 and end[HITS] >= 3.0 * end[OCCASIONS]
    return rests and end[HITS] > 10.0 * end[BESIDE_HITS]


@rounded
def at_limit(end, level):
    """Update the state by the next value; return whether the value is at a limit."""
    if level > end[LEVEL]:
        end[BESIDE], end[BESIDE_HITS] = end[LEVEL], end[HITS]
        end[LEVEL], end[HITS], end[OCCASIONS], end[RUN] = level, 1.0, 1.0, 1.0
        return False
    if level < end[LEVEL]:
        end[RUN] = 0.0
        if level > end[BESIDE]:
            end[BESIDE], end[BESIDE_HITS] = level, 1.0
        elif level == end[BESIDE]:
            end[BESIDE_HITS] += 1.0
        return False
    end[HITS] += 1.0
    end[RUN] += 1.0
    if end[RUN] == 1.0:
        end[OCCASIONS] += 1.0
    return is_limit(end)


@njit(**equations)
def has_limit(values):
    """Whether the largest value of a whole log is a limit."""
    end = np.zeros(N_END)
    end[LEVEL], end[BESIDE] = -np.inf, -np.inf
    for value in values:
        at_limit(end, value)
    return is_limit(end)
