"""Loop of sensors, control law, observer and plant, sample by sample."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.kernels.templates.generated import *
    from flexid.kernels.templates.run_status import *
    from flexid.paper.templates.loop_measures import *


# Content of a record: states, inputs, estimates, their errors, the tracking error and the measured
# states, in this order.
ESTIMATES = N_STATES + N_INPUTS
ERRORS = ESTIMATES + N_COEFFICIENTS
TRACKING = ERRORS + N_COEFFICIENTS
MEASURED = TRACKING + 1
N_RECORD = MEASURED + N_STATES


@njit(**within)
def first_state(estimates):
    """Return the observer's state before the first sample."""
    empty = np.zeros(STATE_SIZE)
    for i in range(N_COEFFICIENTS):
        empty[1 + i] = estimates[i]
    return as_state(empty)


@njit(**within)
def plant_step(x, u, p, h):
    """Return the state after a step of the classical Runge-Kutta method."""
    a = plant_rates(x, u, p)
    b = plant_rates(moved(x, 0.5 * h, a), u, p)
    c = plant_rates(moved(x, 0.5 * h, b), u, p)
    d = plant_rates(moved(x, h, c), u, p)
    return moved(x, h / 6.0, averaged(a, b, c, d))


@njit(**within, forceinline=True)
def move(x, u, p, duration, substeps):
    """Integrate the plant over a duration with a constant input."""
    h = duration / substeps
    for _ in range(substeps):
        x = plant_step(x, u, p, h)
    return x


@njit(**within)
def sense(x, draws, position, velocity, step):
    """Return the measured states: noise from standard normal draws, then the resolution."""
    seen = noisy(x, draws, position, velocity)
    return in_steps(seen, step) if step > 0.0 else seen


@njit(**within)
def exceeds(values, limit):
    """Return 1 if a magnitude exceeds the limit or is not a number, else 0."""
    for value in values:
        if not abs(value) <= limit:
            return 1
    return 0


@njit(**within)
def note(x, u, current, tracking, seen, p, record, n):
    """Write one sample into row n of the record."""
    for i in range(N_STATES):
        record[n, i] = x[i]
        record[n, MEASURED + i] = seen[i]
    for i in range(N_INPUTS):
        record[n, N_STATES + i] = u[i]
    for i in range(N_COEFFICIENTS):
        record[n, ESTIMATES + i] = current[1 + i]
        record[n, ERRORS + i] = current[1 + i] - p[i]
    record[n, TRACKING] = tracking


@njit(**within, forceinline=True)
def respond(x, seen, demanded, current, settings, drive, log):
    """Apply limit, observer, record and plant in a sample; return 1 if an input was cut, too.

    A function of its own, because inside the loop numba counts references to arrays at every
    sample, which takes a fifth of the time.

    drive  the plant's parameters, the limit of its inputs, and steps of the integrator per sample
    log    the reference, the record, and the row of this sample
    """
    p, limit, substeps = drive
    reference, record, n = log
    u, cut = clipped(demanded, limit), exceeds(demanded, limit)
    current, _ = advance(current, seen + u, settings)
    note(x, u, current, x[TRACKED] - reference, seen, p, record, n)
    return move(x, u, p, settings[0], substeps), current, cut


@njit(cache=True, error_model="numpy", nogil=True)
def sampled_run(start, p, constants, sensors, drive, observer, count, record, totals):
    """Run the loop over `count` samples.

    start, p     plain initial states and parameters of the loop, one row each
    sensors      standard normal numbers, a row per sample, or no rows without noise; standard
                 deviations of positions and of velocities; resolution of positions
    drive        limit of the inputs, and steps of the integrator per sample
    observer     initial estimates, and settings of the observer, its sample time first
    record       a row per sample, or a single row for the last sample alone
    totals       zeros, to which each sample's measures are added with weight 1; empty if unwanted
    Returns the status, the number of samples and the number of those with a cut input.
    """
    noise, position, velocity, resolution = sensors
    estimates, set_to = observer
    h = set_to[0]
    settings = (h, 1.0) + as_settings(set_to)[2:]  # a constant tells the compiler: inputs are held
    parameters = as_parameters(p, 0)
    plant = (parameters, drive[0], drive[1])
    current = first_state(estimates)
    x = as_states(start, 0)
    draws = as_states(np.zeros((1, N_STATES)), 0)
    noisy = noise.shape[0] > 0
    r = np.empty(N_COEFFICIENTS)
    known = np.empty(N_ROWS)
    logged = record.shape[0] > 1
    measured = totals.shape[0] > 0
    cuts = 0
    for n in range(count):
        if noisy:
            draws = as_states(noise, n)
        seen = sense(x, draws, position, velocity, resolution)
        demanded, reference = control(n * h, seen, parameters)
        row = n if logged else 0
        log = (reference, record, row)
        x, current, cut = respond(x, seen, demanded, current, settings, plant, log)
        cuts += cut
        if measured:  # views of an array for every sample would take a tenth of the time
            y = record[row]
            regressors(y, y[N_STATES:], constants, r, known)
            add_measures(n * h, 1.0, y[N_STATES:], y[ERRORS:], y[TRACKING], r, p[0], totals)
        if exceeds(x, BOUND):
            return DIVERGED, n + 1, cuts
    # An estimate that is not finite stays so, thus the last state is enough.
    status = FINISHED
    for i in range(N_COEFFICIENTS):
        if not abs(current[1 + i]) < np.inf:
            status = NOT_FINITE
    return status, count, cuts
