"""An extended Kalman filter of states and coefficients."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.dry_motion import (
        Motion,
        cross_interval,
        room_for_derivatives,
        start_derivatives,
    )
    from flexid.kernels.templates.generated import (
        N_COEFFICIENTS,
        N_CORNERS,
        N_INPUTS,
        N_ROWS,
        N_STATES,
        WIDTH,
    )
    from flexid.kernels.templates.runge_kutta import room_for_a_step


SIZE = N_STATES + N_COEFFICIENTS  # states of the model, then its coefficients
INPUTS_AT = SIZE
STARTED_AT = INPUTS_AT + N_INPUTS
COVARIANCE_AT = STARTED_AT + 1
FILTER_SIZE = COVARIANCE_AT + SIZE * SIZE

# Places in the settings.
SAMPLE_TIME, ZERO_ORDER, WITH_VELOCITIES, POSITION_NOISE, VELOCITY_NOISE = 0, 1, 2, 3, 4
ACCELERATION_NOISE, DRIFT, START_VELOCITY, CONSTANTS = 5, 6, 7, 8


@njit(cache=True, error_model="numpy")
def begin(belief, sample, settings):
    """Take position from the sample, velocity from nowhere; the coefficients stay."""
    covariance = belief[COVARIANCE_AT:].reshape((SIZE, SIZE))
    width = 2 if settings[WITH_VELOCITIES] != 0.0 else 1
    for i in range(N_STATES):
        for k in range(SIZE):
            covariance[i, k] = 0.0
            covariance[k, i] = 0.0
    for j in range(N_ROWS):
        belief[2 * j] = sample[width * j]
        belief[2 * j + 1] = 0.0
        covariance[2 * j, 2 * j] = settings[POSITION_NOISE] ** 2
        covariance[2 * j + 1, 2 * j + 1] = settings[START_VELOCITY] ** 2
        if width == 2:
            belief[2 * j + 1] = sample[2 * j + 1]
            covariance[2 * j + 1, 2 * j + 1] = settings[VELOCITY_NOISE] ** 2
    for j in range(N_INPUTS):
        belief[INPUTS_AT + j] = sample[width * N_ROWS + j]
    belief[STARTED_AT] = 1.0


@njit(cache=True, error_model="numpy")
def predict(belief, inputs, settings, work):
    """Bring mean and covariance over one interval; the transition is that of the motion itself."""
    h = settings[SAMPLE_TIME]
    covariance = belief[COVARIANCE_AT:].reshape((SIZE, SIZE))
    product, derivatives, step = work
    z = derivatives.z
    at = np.empty(N_COEFFICIENTS, np.int64)
    for i in range(N_COEFFICIENTS):
        at[i] = 1 + N_STATES + i
    drive = np.zeros((N_INPUTS, 4))
    for j in range(N_INPUTS):
        drive[j, 0] = belief[INPUTS_AT + j]
        if settings[ZERO_ORDER] == 0.0:
            drive[j, 1] = inputs[j] - belief[INPUTS_AT + j]
    start_derivatives(derivatives)
    x = belief[:N_STATES]
    # A filter corrects what it predicts at every sample: no change of mode is located in between.
    modes, dry = np.empty(N_ROWS), np.zeros(N_ROWS, np.bool_)
    for j in range(N_ROWS):
        modes[j] = np.sign(belief[2 * j + 1])
    p, c = belief[N_STATES:SIZE], settings[CONSTANTS:]
    u, du, bends = np.empty(N_INPUTS), np.empty(N_INPUTS), np.empty((2, N_CORNERS))
    motion = Motion(drive, modes, dry, p, c, at, 0, u, du, bends, np.zeros(N_ROWS))
    cross_interval(x, derivatives, h, 1, motion, step, step)
    for i in range(N_STATES):
        for k in range(SIZE):
            value = 0.0
            for j in range(SIZE):
                value += z[i * WIDTH + 1 + j] * covariance[j, k]
            product[i, k] = value
    for i in range(N_STATES):
        for k in range(N_STATES, SIZE):
            covariance[i, k] = product[i, k]
            covariance[k, i] = product[i, k]
        for k in range(i + 1):
            value = 0.0
            for j in range(SIZE):
                value += product[i, j] * z[k * WIDTH + 1 + j]
            covariance[i, k] = value
            covariance[k, i] = value
    for j in range(N_ROWS):
        # White noise of acceleration, over one interval
        variance = settings[ACCELERATION_NOISE] ** 2 * h
        covariance[2 * j, 2 * j] += variance * h * h / 3.0
        covariance[2 * j, 2 * j + 1] += 0.5 * variance * h
        covariance[2 * j + 1, 2 * j] += 0.5 * variance * h
        covariance[2 * j + 1, 2 * j + 1] += variance
    for i in range(N_STATES, SIZE):
        covariance[i, i] += (settings[DRIFT] * belief[i]) ** 2 * h
    for j in range(N_INPUTS):
        belief[INPUTS_AT + j] = inputs[j]


@njit(cache=True, error_model="numpy")
def correct(belief, place, measured, noise):
    """One measured state, after Joseph: the covariance stays symmetric and positive."""
    covariance = belief[COVARIANCE_AT:].reshape((SIZE, SIZE))
    spread = covariance[place, place] + noise * noise
    innovation = measured - belief[place]
    column = covariance[:, place].copy()
    for i in range(SIZE):
        belief[i] += column[i] / spread * innovation
    for i in range(SIZE):
        gain = column[i] / spread
        for k in range(i + 1):
            other = column[k] / spread
            value = covariance[i, k] - gain * column[k] - column[i] * other + gain * other * spread
            covariance[i, k] = value
            covariance[k, i] = value


@njit(cache=True, error_model="numpy")
def run(belief, samples, settings, coefficients):
    """Take in samples; belief changes in place, coefficients receive the estimates."""
    width = 2 if settings[WITH_VELOCITIES] != 0.0 else 1
    derivatives = room_for_derivatives(1 + SIZE, False)
    work = np.empty((N_STATES, SIZE)), derivatives, room_for_a_step()
    for n in range(samples.shape[0]):
        sample = samples[n]
        if belief[STARTED_AT] == 0.0:
            begin(belief, sample, settings)
        else:
            predict(belief, sample[width * N_ROWS :], settings, work)
            for j in range(N_ROWS):
                correct(belief, 2 * j, sample[width * j], settings[POSITION_NOISE])
                if width == 2:
                    correct(belief, 2 * j + 1, sample[2 * j + 1], settings[VELOCITY_NOISE])
        for i in range(N_COEFFICIENTS):
            coefficients[n, i] = belief[N_STATES + i]
