"""Explicit Runge-Kutta method of order 5 for several runs side by side, each at its own step.

For problems that are not stiff. J. R. Dormand and P. J. Prince, "A family of embedded Runge-Kutta
formulae", Journal of Computational and Applied Mathematics 6 (1980) 19-26.

The runs lie in one flat array w: number `slot` of run `lane` is w[at(slot, lane)]. A loop over
lanes that has neither branch nor call becomes vector instructions. It would not with an array of
two dimensions, or one for each kind of number, because then LLVM cannot tell that slots do not
overlap. A run's numbers do not depend on LANES.
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
STEP = 1  # length of the step that is tried
END = 2  # time at its end
STAGE_TIME = 3
BEFORE = 4  # length of the step that led to the state
ERROR = 5  # mean square of the estimated errors over what is allowed
REJECTED = 6  # 1 where the last step was, or else 0
RUN = 7  # its number, or -1 where there is none
ACCEPTED_STEPS = 8
REJECTED_STEPS = 9
STATUS = 10  # what became of the run, or GOES_ON
GROWTH = 11  # of the next step over this one
WEIGHT = 12  # of the state in means over time
STATE = 13
STAGE = STATE + SIZE  # state of a stage, at last the new one
PARAMETERS = STAGE + SIZE
EARLIER = PARAMETERS + N_PARAMETERS  # rates of six earlier stages
RATES = EARLIER + 6 * SIZE  # at STAGE
OBSERVED = RATES + SIZE  # what measures are taken of, at STATE
NEXT_OBSERVED = OBSERVED + N_OBSERVED  # and at STAGE
TOTALS = NEXT_OBSERVED + N_OBSERVED
SLOTS = TOTALS + N_MEASURES

GOES_ON = -1


@njit(**within, forceinline=True)
def at(slot, lane):
    """Where number `slot` of run `lane` is."""
    return slot * LANES + lane


@njit(**within, forceinline=True)
def rate(stage, i, lane):
    """Where the rates of a stage are, of which there are seven."""
    return at(EARLIER + stage * SIZE + i, lane)


@njit(**within, fastmath={"contract"})
def begin_step(w, stop, longest_step):
    """Begin a step, no longer than the longest one and the rest of the run: to the second stage."""
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


# The compiler has to know where everything is written, or the loops become no vector instructions:
# so a stage is compiled for each number of weights, and there is no loop over stages.


@njit(**within, fastmath={"contract"})
def go_to_stage(w, node, weights):
    """Keep the rates at STAGE, and go on; one weight for the rates of each stage so far."""
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
    """One step of every lane from STATE to STAGE; the first stage is there, the last is RATES."""
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
    """Mean square of the errors over what is allowed, and how far the next step is to grow."""
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
        # The fourth root of the error instead of the customary fifth, which would be a call.
        growth = 0.9 / sqrt(sqrt(sqrt(1e-20 if square < 1e-20 else square)))
        most = 1.0 if w[at(REJECTED, lane)] == 1.0 else 5.0
        growth = most if growth > most else growth
        w[at(GROWTH, lane)] = growth if growth > 0.1 else 0.1  # also where the error is no number


@njit(**within)
def end_step(w, stop, limit, most_steps):
    """Go to the end of accepted steps, choose the next step, and see which runs end."""
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
    """Keep the largest magnitude of a number of a lane."""
    size = abs(w[at(of, lane)])
    highest = w[at(peak, lane)]
    w[at(peak, lane)] = size if size > highest else highest


@njit(**within, fastmath={"contract"})
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


@njit(**within)
def ended_runs(w):
    """Number of lanes whose run has come to its end."""
    ended = 0
    for lane in range(LANES):
        ended += w[at(STATUS, lane)] != GOES_ON
    return ended


@njit(**within)
def enter(w, lane, run, start, z, p, first_step):
    """Put a run into a lane."""
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
    """Rates and outputs at every lane's state; where a run is under way they are what they were."""
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
    """Take the end, the totals and the steps of a run out of its lane, which is free then."""
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
    """Integrate z' = rates(t, z, p) over a span; arguments are those of rodas5p.

    No samples are taken.
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
            ended = ended_runs(w)
        left += ended
        for lane in range(LANES):
            if w[at(STATUS, lane)] != GOES_ON:
                run = int(w[at(RUN, lane)])
                status[run] = int(w[at(STATUS, lane)])
                reached[run] = w[at(TIME, lane)]
                leave(w, lane, z[run], p[run], totals[run], counts[run])
