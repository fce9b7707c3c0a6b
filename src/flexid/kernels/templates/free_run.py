"""Free run of a model under a recorded input.

All models share this kernel, which calls a model's right-hand side by its address.
"""

from collections import namedtuple
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.compiled import *
    from flexid.kernels.templates.run_status import *
    from flexid.kernels.templates.runge_kutta import *

# Address of the model, input at the start of an interval and its change over the interval,
# coefficients, constants, and an array for the input within the interval.
Motion = namedtuple("Motion", "address start change p c u")


@inlined
def rates_at(x, place, motion, rate):
    """Compute the rates of x at a place from 0 to 1 within the interval."""
    for j in range(motion.u.shape[0]):
        motion.u[j] = motion.start[j] + place * motion.change[j]
    call(motion.address, x, motion.u, motion.p, motion.c, rate)


@inlined
def recall(x, start, motion):
    """Do nothing: memories follow from their rates."""


@njit(**equations)
def free_run(address, x0, u, p, c, h, held, substeps, out):
    """Integrate the model under its inputs, in steps of h / substeps seconds.

    Between samples the input is held or interpolated linearly.
    Return the number of samples written, which is smaller than u's if the motion diverged.
    """
    n_states, n_inputs = x0.shape[0], u.shape[1]
    x, end = x0.copy(), np.empty(n_states)
    work = end, np.empty(n_states), np.empty(4 * n_states)
    change, room = np.zeros(n_inputs), np.empty(n_inputs)
    for k in range(u.shape[0]):
        for j in range(n_states):
            if not abs(x[j]) < BOUND and k > 0:
                return k
            out[k, j] = x[j]
        if k + 1 == u.shape[0]:
            break
        if not held:
            for j in range(n_inputs):
                change[j] = u[k + 1, j] - u[k, j]
        motion = Motion(address, u[k], change, p, c, room)
        for s in range(substeps):
            runge_kutta(x, s / substeps, 1.0 / substeps, h, motion, work)
            for j in range(n_states):
                x[j] = end[j]
    return u.shape[0]
