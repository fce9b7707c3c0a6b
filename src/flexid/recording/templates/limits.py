"""Limits of sensors and inputs, found sample by sample: of a stream's, and of a whole log's."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *

# Of a signal at its upper end: extreme, samples there, occasions, samples in a row; the level next
# to it.
LEVEL, HITS, OCCASIONS, RUN, BESIDE, BESIDE_HITS = range(6)
N_END = 6


@rounded
def is_limit(end):
    """Whether a signal rests at its extreme again and again, which no free signal does.

    Far more samples are there than at the level beside it, in some long rests.
    """
    rests = end[OCCASIONS] >= 2.0 and end[HITS] >= 3.0 * end[OCCASIONS]
    return rests and end[HITS] > 10.0 * end[BESIDE_HITS]


@rounded
def at_limit(end, level):
    """Whether the next value is at the limit of its signal."""
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
