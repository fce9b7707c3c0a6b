"""Explicit Runge-Kutta method of order 5 for several runs in parallel, each with its own step.

For nonstiff problems. J. R. Dormand and P. J. Prince, "A family of embedded Runge-Kutta
formulae", Journal of Computational and Applied Mathematics 6 (1980) 19-26.

The runs share one flat array w: number `slot` of run `lane` is w[at(slot, lane)]. A loop over
lanes without branches and calls is compiled to vector instructions. With a two-dimensional array,
or an array for each kind of number, LLVM could not exclude that slots overlap. A run's results do
not depend on LANES.
"""

from math import sqrt
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import *
    from flexid.kernels.templates.run_status import *
    from flexid.paper.templates.loop_measures import *
    from flexid.paper.templates.loop_outputs import *


TIME = 0  # of the state
STEP = 1  # length of the current step
END = 2  # time at its end
STAGE_TIME = 3
BEFORE = 4  # length of the step that led to the state
ERROR = 5  # mean square of the estimated errors over their tolerances
REJECTED = 6  # 1 if the last step was rejected, else 0
RUN = 7  # number of the run, or -1 if the lane is free
ACCEPTED_STEPS = 8
REJECTED_STEPS = 9
STATUS = 10  # final status of the run, or GOES_ON
GROWTH = 11  # of the next step over this one
WEIGHT = 12  # of the state in integrals over time
STATE = 13
STAGE = STATE + SIZE  # state of a stage, finally the new state
PARAMETERS = STAGE + SIZE
EARLIER = PARAMETERS + N_PARAMETERS  # rates of six earlier stages
RATES = EARLIER + 6 * SIZE  # at STAGE
OBSERVED = RATES + SIZE  # outputs for the measures, at STATE
NEXT_OBSERVED = OBSERVED + N_OBSERVED  # the same outputs at STAGE
TOTALS = NEXT_OBSERVED + N_OBSERVED
SLOTS = TOTALS + N_MEASURES

GOES_ON = -1


@njit(**within, forceinline=True)
def at(slot, lane):
    """Return the place of number `slot` of run `lane`."""
    return slot * LANES + lane


@njit(**within, forceinline=True)
def rate(stage, i, lane):
    """Return the place of rate i of a stage (0 to 6)."""
    return at(EARLIER + stage * SIZE + i, lane)


@njit(**within, fastmath={"contract"})
def begin_step(w, stop, longest_step):
    """Limit the step to the longest one and the end of the run, and go to the second stage."""
    for lane in range(LANES):
        t = w[at(TIME, lane)]
        h = w[at(STEP, lane)]
        h = h if h < longest_step else longest_step
        last = t + h >= stop
        h = stop - t if last else h
        w[at(STEP, lane)] = h
        w[at(END, lane)] = stop if last else t + h
        w[at(STAGE_TIME, lane)] = t + 0.2 * h
        for i in range(SIZE):
            w[at(STAGE + i, lane)] = w[at(STATE + i, lane)] + h * (1.0 / 5.0 * w[rate(0, i, lane)])


# Vector instructions need places that are known when compiling. So a stage is compiled for each
# number of weights, and there is no loop over stages.


@njit(**within, fastmath={"contract"})
def go_to_stage(w, node, weights):
    """Store the rates at STAGE and go to the next stage, with a weight for each earlier one."""
    latest = len(weights) - 1
    for lane in range(LANES):
        h = w[at(STEP, lane)]
        w[at(STAGE_TIME, lane)] = w[at(TIME, lane)] + node * h
        for i in range(SIZE):
            now = w[at(RATES + i, lane)]
            w[rate(latest, i, lane)] = now
            total = weights[0] * w[rate(0, i, lane)]
            for j in range(1, latest):
                total += weights[j] * w[rate(j, i, lane)]
            w[at(STAGE + i, lane)] = w[at(STATE + i, lane)] + h * (total + weights[latest] * now)


# fmt: off
THIRD = (3.0 / 40.0, 9.0 / 40.0)
FOURTH = (44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0)
FIFTH = (19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0)
SIXTH = (9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0)
LAST = (35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0)
# fmt: on


@njit(**within)
def dormand_step(w, stop, longest_step):
    """Take one step of every lane from STATE to STAGE, given its first stage; RATES is the last."""
    begin_step(w, stop, longest_step)
    lane_rates(w)
    go_to_stage(w, 0.3, THIRD)
    lane_rates(w)
    go_to_stage(w, 0.8, FOURTH)
    lane_rates(w)
    go_to_stage(w, 8.0 / 9.0, FIFTH)
    lane_rates(w)
    go_to_stage(w, 1.0, SIXTH)
    lane_rates(w)
    go_to_stage(w, 1.0, LAST)
    lane_rates_and_outputs(w)


@njit(**within, fastmath={"contract"})
def dormand_error(w, relative, absolute):
    """Compute the mean square of the errors over their tolerances, and the step's growth."""
    for lane in range(LANES):
        h = w[at(STEP, lane)]
        total = 0.0
        for i in range(SIZE):
            error = h * (
                71.0 / 57600.0 * w[rate(0, i, lane)]
                - 71.0 / 16695.0 * w[rate(2, i, lane)]
                + 71.0 / 1920.0 * w[rate(3, i, lane)]
                - 17253.0 / 339200.0 * w[rate(4, i, lane)]
                + 22.0 / 525.0 * w[rate(5, i, lane)]
                - 1.0 / 40.0 * w[rate(6, i, lane)]
            )
            before = abs(w[at(STATE + i, lane)])
            after = abs(w[at(STAGE + i, lane)])
            share = error / (absolute + relative * (before if before > after else after))
            total += share * share
        square = total / SIZE
        w[at(ERROR, lane)] = square
        # The fourth root of the error instead of the usual fifth, which would be a function call.
        growth = 0.9 / sqrt(sqrt(sqrt(1e-20 if square < 1e-20 else square)))
        most = 1.0 if w[at(REJECTED, lane)] == 1.0 else 5.0
        growth = most if growth > most else growth
        w[at(GROWTH, lane)] = growth if growth > 0.1 else 0.1  # also if the error is NaN


@njit(**within)
def end_step(w, stop, limit, most_steps):
    """Move to the end of accepted steps, choose the next steps, and set the status of runs."""
    for lane in range(LANES):
        square = w[at(ERROR, lane)]
        accepted = square <= 1.0
        t = w[at(END, lane)] if accepted else w[at(TIME, lane)]
        h = w[at(STEP, lane)]
        following = w[at(GROWTH, lane)] * h
        w[at(TIME, lane)] = t
        w[at(STEP, lane)] = following
        w[at(BEFORE, lane)] = h if accepted else w[at(BEFORE, lane)]
        w[at(REJECTED, lane)] = 0.0 if accepted else 1.0
        taken = w[at(ACCEPTED_STEPS, lane)] + (1.0 if accepted else 0.0)
        refused = w[at(REJECTED_STEPS, lane)] + (0.0 if accepted else 1.0)
        w[at(ACCEPTED_STEPS, lane)] = taken
        w[at(REJECTED_STEPS, lane)] = refused
        largest = 0.0
        for i in range(SIZE):
            z = w[at(STAGE + i, lane)] if accepted else w[at(STATE + i, lane)]
            largest = abs(z) if abs(z) > largest else largest
            w[at(STATE + i, lane)] = z
            w[rate(0, i, lane)] = w[at(RATES + i, lane)] if accepted else w[rate(0, i, lane)]
        status = TOO_MANY_STEPS if taken + refused >= most_steps else GOES_ON
        status = FINISHED if t >= stop else status
        status = DIVERGED if accepted & (largest > limit) else status
        stuck = STEP_TOO_SMALL if square < np.inf else NOT_FINITE
        status = status if accepted | (t + 0.01 * following > t) else stuck
        w[at(STATUS, lane)] = status if w[at(RUN, lane)] >= 0.0 else GOES_ON
    for lane in range(LANES):
        accepted = w[at(ERROR, lane)] <= 1.0
        for i in range(N_OBSERVED):
            w[at(OBSERVED + i, lane)] = (
                w[at(NEXT_OBSERVED + i, lane)] if accepted else w[at(OBSERVED + i, lane)]
            )


OBSERVED_ERRORS = OBSERVED + N_INPUTS
OBSERVED_TRACKING = OBSERVED_ERRORS + N_COEFFICIENTS
OBSERVED_REGRESSORS = OBSERVED_TRACKING + 1


@njit(**within, forceinline=True)
def raise_peak(w, peak, of, lane):
    """Update the largest magnitude of a number of a lane."""
    size = abs(w[at(of, lane)])
    highest = w[at(peak, lane)]
    w[at(peak, lane)] = size if size > highest else highest


@njit(**within, fastmath={"contract"})
def lane_measures(w):
    """Add the state of each run whose step was accepted to its totals.

    Loops without conditions are faster. So peaks and settling are updated after rejected steps,
    too, which changes nothing, and products of regressors are formed for all pairs of rows.
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


@njit(**within)
def enter(w, lane, run, start, z, p, first_step):
    """Start a run in a lane."""
    for slot in range(SLOTS):
        w[at(slot, lane)] = 0.0
    w[at(RUN, lane)] = run
    w[at(TIME, lane)] = start
    w[at(STEP, lane)] = first_step
    for i in range(SIZE):
        w[at(STATE + i, lane)] = z[i]
    for i in range(N_PARAMETERS):
        w[at(PARAMETERS + i, lane)] = p[i]


@njit(**within)
def begin_runs(w):
    """Compute rates and outputs at every lane's state; those of older runs do not change."""
    for lane in range(LANES):
        w[at(STAGE_TIME, lane)] = w[at(TIME, lane)]
        for i in range(SIZE):
            w[at(STAGE + i, lane)] = w[at(STATE + i, lane)]
    lane_rates_and_outputs(w)
    for lane in range(LANES):
        for i in range(SIZE):
            w[rate(0, i, lane)] = w[at(RATES + i, lane)]
        for i in range(N_OBSERVED):
            w[at(OBSERVED + i, lane)] = w[at(NEXT_OBSERVED + i, lane)]


@njit(**within)
def leave(w, lane, z, p, totals, counts):
    """Return a run's final state, totals and numbers of steps, and free its lane."""
    for i in range(SIZE):
        z[i] = w[at(STATE + i, lane)]
    if totals.shape[0] > 0:
        for i in range(N_MEASURES):
            totals[i] = w[at(TOTALS + i, lane)]
        observe(w[at(TIME, lane)], 0.5 * w[at(BEFORE, lane)], z, p, totals)
    counts[0] = int(w[at(ACCEPTED_STEPS, lane)])
    counts[1] = int(w[at(REJECTED_STEPS, lane)])
    w[at(RUN, lane)] = -1.0


@njit(cache=True, error_model="numpy", nogil=True)
def integrate(span, z, p, steps, _sampling, totals, results):
    """Integrate z' = rates(t, z, p) over a span, with the arguments of rodas5p.

    The sampling is ignored.
    """
    start, stop = span
    relative, absolute, first_step, longest_step, limit, most_steps = steps
    status, reached, counts = results
    runs = z.shape[0]
    w = np.zeros(SLOTS * LANES)
    for lane in range(LANES):
        w[at(RUN, lane)] = -1.0
    entered = 0
    left = 0
    while left < runs:
        for lane in range(LANES):
            if w[at(RUN, lane)] < 0.0 and entered < runs:
                enter(w, lane, entered, start, z[entered], p[entered], first_step)
                entered += 1
        begin_runs(w)
        ended = 0
        while ended == 0:
            dormand_step(w, stop, longest_step)
            dormand_error(w, relative, absolute)
            if totals.shape[1] > 0:
                lane_measures(w)
            end_step(w, stop, limit, most_steps)
            for lane in range(LANES):
                ended += w[at(STATUS, lane)] != GOES_ON
        left += ended
        for lane in range(LANES):
            if w[at(STATUS, lane)] != GOES_ON:
                run = int(w[at(RUN, lane)])
                status[run] = int(w[at(STATUS, lane)])
                reached[run] = w[at(TIME, lane)]
                leave(w, lane, z[run], p[run], totals[run], counts[run])
