"""The measures of `loop_measures`, of all lanes at once.

OBSERVED holds inputs, errors, tracking error and regressors in turn.
"""

from typing import TYPE_CHECKING

from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import *
    from flexid.kernels.templates.lanes import *
    from flexid.kernels.templates.loop_measures import *


OBSERVED_ERRORS = OBSERVED + N_INPUTS
OBSERVED_TRACKING = OBSERVED_ERRORS + N_COEFFICIENTS
OBSERVED_REGRESSORS = OBSERVED_TRACKING + 1


@njit(cache=True, error_model="numpy", forceinline=True)
def raise_peak(w, peak, of, lane):
    """Keep the largest magnitude of a number of a lane."""
    size = abs(w[at(of, lane)])
    highest = w[at(peak, lane)]
    w[at(peak, lane)] = size if size > highest else highest


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def lane_measures(w):
    """Take the state of each run whose step is accepted into its totals.

    Peaks and settling do not ask whether it is, because the state counts anyhow; and products of
    regressors are of all pairs, not of each row's alone: loops without conditions are faster.
    """
    for lane in range(LANES):
        weight = (
            0.5 * (w[at(BEFORE, lane)] + w[at(STEP, lane)]) if w[at(ERROR, lane)] <= 1.0 else 0.0
        )
        w[at(WEIGHT, lane)] = weight
        tracking = w[at(OBSERVED_TRACKING, lane)]
        w[at(TOTALS, lane)] += weight * tracking * tracking
    for lane in range(LANES):
        raise_peak(w, TOTALS + 1, OBSERVED_TRACKING, lane)
        for i in range(N_INPUTS):
            raise_peak(w, TOTALS + PEAKS + i, OBSERVED + i, lane)
    for lane in range(LANES):
        for i in range(N_COEFFICIENTS):
            settled = abs(w[at(OBSERVED_ERRORS + i, lane)]) <= SETTLED * abs(
                w[at(PARAMETERS + i, lane)]
            )
            unsettled = w[at(TOTALS + UNSETTLED + i, lane)]
            w[at(TOTALS + UNSETTLED + i, lane)] = unsettled if settled else w[at(TIME, lane)]
    for lane in range(LANES):
        for i in range(N_COEFFICIENTS):
            weighted = w[at(WEIGHT, lane)] * w[at(OBSERVED_REGRESSORS + i, lane)]
            for j in range(i + 1):
                w[at(TOTALS + GRAM + i * N_COEFFICIENTS + j, lane)] += (
                    weighted * w[at(OBSERVED_REGRESSORS + j, lane)]
                )
