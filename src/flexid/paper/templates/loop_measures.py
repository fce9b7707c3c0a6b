"""Measures of a closed loop, accumulated while it runs."""

from typing import TYPE_CHECKING

from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import *
    from flexid.kernels.templates.run_status import *


SETTLED = 0.05  # largest error of a settled estimate, over the coefficient

# Content of totals: the integral of the square and the largest magnitude of the tracking error, the
# largest magnitude of each input, the last time at which each estimate was not settled, and the
# integrals of the products of each row's regressors (lower triangle).
PEAKS = 2
UNSETTLED = PEAKS + N_INPUTS
GRAM = UNSETTLED + N_COEFFICIENTS
N_MEASURES = GRAM + N_COEFFICIENTS * N_COEFFICIENTS


@njit(**within)
def add_measures(t, weight, inputs, errors, tracking, regressors, true, totals):
    """Add one instant to the totals of a run."""
    totals[0] += weight * tracking * tracking
    totals[1] = max(totals[1], abs(tracking))
    for i in range(N_INPUTS):
        totals[PEAKS + i] = max(totals[PEAKS + i], abs(inputs[i]))
    for i in range(N_COEFFICIENTS):
        if not abs(errors[i]) <= SETTLED * abs(true[i]):
            totals[UNSETTLED + i] = t
    for row in range(len(ROW_STARTS) - 1):
        for i in range(ROW_STARTS[row], ROW_STARTS[row + 1]):
            for j in range(ROW_STARTS[row], i + 1):
                totals[GRAM + i * N_COEFFICIENTS + j] += weight * regressors[i] * regressors[j]
