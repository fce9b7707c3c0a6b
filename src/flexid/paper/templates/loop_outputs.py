"""Outputs of a closed loop, and its measures.

`outputs` fills y with states, inputs, estimates, their errors, the tracking error and the
regressors, in this order.
"""

from typing import TYPE_CHECKING

from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import *
    from flexid.kernels.templates.run_status import *
    from flexid.paper.templates.loop_measures import *


N_OUTPUTS = N_STATES + N_INPUTS + 3 * N_COEFFICIENTS + 1
N_TOTALS = N_MEASURES + N_OUTPUTS  # measures, then the last outputs


@njit(cache=True, error_model="numpy")
def sampled_outputs(sample_time, samples, p, y):
    """Compute the outputs of the loop at every sample, the first at time 0."""
    for place in range(samples.shape[0]):
        outputs(place * sample_time, samples[place], p, y[place])


@njit(**within)
def observe(t, weight, z, p, totals):
    """Add one state of the loop to the totals; its parameters begin with the true coefficients."""
    y = totals[N_MEASURES:]
    outputs(t, z, p, y)
    inputs = y[N_STATES:]
    errors = inputs[N_INPUTS + N_COEFFICIENTS :]
    regressors = errors[N_COEFFICIENTS + 1 :]
    add_measures(t, weight, inputs, errors, errors[N_COEFFICIENTS], regressors, p, totals)
