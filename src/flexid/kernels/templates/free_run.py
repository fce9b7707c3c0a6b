"""The motion of a model under a recorded input."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.bound import BOUND
    from flexid.kernels.templates.generated import N_INPUTS, N_STATES
    from flexid.kernels.templates.held_rates import Motion
    from flexid.kernels.templates.runge_kutta import room_for_a_step, runge_kutta


@njit(cache=True, error_model="numpy")
def free_run(x0, u, p, c, h, held, substeps, out):
    """Integrate the model under a recorded input, in steps of h / substeps seconds.

    Between samples the input is held (held = 1) or interpolated linearly (held = 0).
    Returns the number of samples written: fewer than asked for if the motion diverged.
    """
    x = np.empty(N_STATES)
    work = room_for_a_step()
    end = work[0]
    change = np.zeros(N_INPUTS)
    for j in range(N_STATES):
        x[j] = x0[j]
        out[0, j] = x0[j]
    room = np.empty(N_INPUTS)
    for i in range(u.shape[0] - 1):
        if not held:
            for j in range(N_INPUTS):
                change[j] = u[i + 1, j] - u[i, j]
        motion = Motion(u[i], change, p, c, room)
        for s in range(substeps):
            runge_kutta(x, s / substeps, 1.0 / substeps, h, motion, work)
            for j in range(N_STATES):
                x[j] = end[j]
        for j in range(N_STATES):
            if not abs(x[j]) < BOUND:
                return i + 1
            out[i + 1, j] = x[j]
    return u.shape[0]
