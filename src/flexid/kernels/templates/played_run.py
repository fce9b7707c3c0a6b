"""The motion of a model whose drive plays a torque or follows a reference."""

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import N_INPUTS, N_STATES, right_hand_side


@njit(cache=True, error_model="numpy")
def played_run(x0, torque, reference, gains, tracked, limit, p, c, h, substeps, states, inputs):
    """Integrate the model while a drive plays a torque, or follows a reference, sample by sample.

    The first input is torque[k] + gains[0] (reference[k, 0] - x[tracked])
    + gains[1] (reference[k, 1] - x[tracked + 1]), cut at the limit and held until the next sample;
    others are zero. Fills `states` and `inputs` and returns the number of samples written: fewer
    than asked for if the motion diverged.
    """
    n = torque.shape[0]
    x = x0.copy()
    xs = np.empty(N_STATES)
    u = np.zeros(N_INPUTS)
    k1 = np.empty(N_STATES)
    k2 = np.empty(N_STATES)
    k3 = np.empty(N_STATES)
    k4 = np.empty(N_STATES)
    d = h / substeps
    for k in range(n):
        states[k] = x
        wanted = torque[k] + gains[0] * (reference[k, 0] - x[tracked])
        wanted += gains[1] * (reference[k, 1] - x[tracked + 1])
        u[0] = min(max(wanted, -limit), limit)
        inputs[k] = u[0]
        for _ in range(substeps):
            right_hand_side(x, u, p, c, k1)
            xs[:] = x + 0.5 * d * k1
            right_hand_side(xs, u, p, c, k2)
            xs[:] = x + 0.5 * d * k2
            right_hand_side(xs, u, p, c, k3)
            xs[:] = x + d * k3
            right_hand_side(xs, u, p, c, k4)
            x += d / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        if not np.all(np.abs(x) < 1e12):
            return k + 1
    return n
