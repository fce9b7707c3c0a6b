"""The motion of a model under a recorded input."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import N_INPUTS, N_STATES, right_hand_side


@njit(cache=True, error_model="numpy")
def free_run(x0, u, p, c, h, held, substeps, out):
    """Integrate the model under a recorded input with the classical Runge-Kutta method.

    Between samples the input is held (held = 1) or interpolated linearly (held = 0).
    Returns the number of samples written: fewer than asked for if the motion diverged.

    State by state: a sum of arrays would ask for new memory at every step.
    """
    n = u.shape[0]
    x = x0.copy()
    xs = np.empty(N_STATES)
    us = np.empty(N_INPUTS)
    slope = np.zeros(N_INPUTS)
    k1 = np.empty(N_STATES)
    k2 = np.empty(N_STATES)
    k3 = np.empty(N_STATES)
    k4 = np.empty(N_STATES)
    d = h / substeps
    out[0] = x
    for i in range(n - 1):
        if not held:
            for j in range(N_INPUTS):
                slope[j] = (u[i + 1, j] - u[i, j]) / substeps
        for s in range(substeps):
            for j in range(N_INPUTS):
                us[j] = u[i, j] + slope[j] * s
            right_hand_side(x, us, p, c, k1)
            for j in range(N_INPUTS):
                us[j] = u[i, j] + slope[j] * (s + 0.5)
            for j in range(N_STATES):
                xs[j] = x[j] + 0.5 * d * k1[j]
            right_hand_side(xs, us, p, c, k2)
            for j in range(N_STATES):
                xs[j] = x[j] + 0.5 * d * k2[j]
            right_hand_side(xs, us, p, c, k3)
            for j in range(N_INPUTS):
                us[j] = u[i, j] + slope[j] * (s + 1.0)
            for j in range(N_STATES):
                xs[j] = x[j] + d * k3[j]
            right_hand_side(xs, us, p, c, k4)
            for j in range(N_STATES):
                x[j] += d / 6.0 * (k1[j] + 2.0 * k2[j] + 2.0 * k3[j] + k4[j])
        for j in range(N_STATES):
            if not abs(x[j]) < 1e12:
                return i + 1
            out[i + 1, j] = x[j]
    return n
