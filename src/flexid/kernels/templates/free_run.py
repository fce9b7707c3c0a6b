"""The motion of a model under a recorded input, or of one whose drive follows a reference."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.bound import BOUND
    from flexid.kernels.templates.generated import N_INPUTS, N_STATES
    from flexid.kernels.templates.held_rates import Motion
    from flexid.kernels.templates.runge_kutta import room_for_a_step, runge_kutta


@njit(cache=True, error_model="numpy")
def free_run(x0, u, loop, p, c, h, held, substeps, out):
    """Integrate the model under its inputs, in steps of h / substeps seconds.

    Between samples the input is held or interpolated linearly. The loop is (tracked, reference,
    gains): if there is a reference, the first input of each sample grows by
    gains[0] (reference[k, 0] - x[tracked]) + gains[1] (reference[k, 1] - x[tracked + 1]).
    Returns the number of samples written: fewer than asked for if the motion diverged.
    """
    tracked, reference, gains = loop
    x = x0.copy()
    work = room_for_a_step()
    end = work[0]
    change = np.zeros(N_INPUTS)
    room = np.empty(N_INPUTS)
    for k in range(u.shape[0]):
        if reference.shape[0] > 0:
            u[k, 0] += gains[0] * (reference[k, 0] - x[tracked])
            u[k, 0] += gains[1] * (reference[k, 1] - x[tracked + 1])
        for j in range(N_STATES):
            if not abs(x[j]) < BOUND and k > 0:
                return k
            out[k, j] = x[j]
        if k + 1 == u.shape[0]:
            break
        if not held:
            for j in range(N_INPUTS):
                change[j] = u[k + 1, j] - u[k, j]
        motion = Motion(u[k], change, p, c, room)
        for s in range(substeps):
            runge_kutta(x, s / substeps, 1.0 / substeps, h, motion, work)
            for j in range(N_STATES):
                x[j] = end[j]
    return u.shape[0]
