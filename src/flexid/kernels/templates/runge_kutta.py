"""The classical Runge-Kutta step, for whatever rates a kernel has.

Another template gives ``rates_at(z, place, motion, rate)``, which fills `rate` with the
rates of z, both of shape (N_STATES, n), at a place within the sampling interval: 0 at its start, 1
at its end. What it needs beyond that is the tuple `motion`. And it gives ``recall(z, start,
motion)``, which may set states of z that follow from the path since the start of the step.
"""

from typing import TYPE_CHECKING

from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import N_STATES
    from flexid.kernels.templates.prediction_error import rates_at, recall


@njit(cache=True, error_model="numpy")
def runge_kutta(z, place, span, h, motion, work):
    """Bring z over a span of an interval of h seconds; the end is the first array of the work.

    Only as many columns of z as the arrays of the work have.
    """
    end, rate, trial = work
    step = span * h
    for i in range(N_STATES):
        for j in range(end.shape[1]):
            end[i, j] = z[i, j]
            trial[i, j] = z[i, j]
    for stage in range(4):
        node = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        reach = 0.5 if stage < 2 else 1.0
        weight = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
        rates_at(trial, place + node * span, motion, rate)
        for i in range(N_STATES):
            for j in range(end.shape[1]):
                end[i, j] += weight * rate[i, j]
                trial[i, j] = z[i, j] + reach * step * rate[i, j]
        recall(trial, z, motion)
    recall(end, z, motion)
