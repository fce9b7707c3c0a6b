"""The motion of a model whose drive plays a torque or follows a reference."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.bound import BOUND
    from flexid.kernels.templates.generated import N_INPUTS, N_STATES
    from flexid.kernels.templates.held_rates import Motion
    from flexid.kernels.templates.runge_kutta import room_for_a_step, runge_kutta


@njit(cache=True, error_model="numpy")
def played_run(x0, command, tracked, p, c, h, substeps, states, inputs):
    """Integrate the model while a drive plays a torque, or follows a reference, sample by sample.

    The command is (torque, reference, gains). The first input is torque[k]
    + gains[0] (reference[k, 0] - x[tracked]) + gains[1] (reference[k, 1] - x[tracked + 1]), held
    until the next sample; others are zero. Fills `states` and `inputs` and returns the number of
    samples written: fewer than asked for if the motion diverged.
    """
    torque, reference, gains = command
    x = np.empty(N_STATES)
    work = room_for_a_step()
    end = work[0]
    u = np.zeros(N_INPUTS)
    motion = Motion(u, np.zeros(N_INPUTS), p, c, np.empty(N_INPUTS))
    for j in range(N_STATES):
        x[j] = x0[j]
    for k in range(torque.shape[0]):
        u[0] = torque[k] + gains[0] * (reference[k, 0] - x[tracked])
        u[0] += gains[1] * (reference[k, 1] - x[tracked + 1])
        inputs[k] = u[0]
        for j in range(N_STATES):
            states[k, j] = x[j]
        for _ in range(substeps):
            runge_kutta(x, 0.0, 1.0 / substeps, h, motion, work)
            for j in range(N_STATES):
                x[j] = end[j]
        for j in range(N_STATES):
            if not abs(x[j]) < BOUND:
                return k + 1
    return torque.shape[0]
