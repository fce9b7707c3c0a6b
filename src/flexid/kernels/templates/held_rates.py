"""Rates of a model alone, under an input that is constant or linear over an interval."""

from collections import namedtuple
from typing import TYPE_CHECKING

from numba import njit

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import N_INPUTS, right_hand_side

# The input at the start of an interval and its change over it, coefficients, constants, and room.
Motion = namedtuple("Motion", "start change p c u")


@njit(cache=True, error_model="numpy")
def rates_at(z, place, motion, rate):
    """Rates of the one column of z at a place within the interval."""
    for j in range(N_INPUTS):
        motion.u[j] = motion.start[j] + place * motion.change[j]
    right_hand_side(z[:, 0], motion.u, motion.p, motion.c, rate[:, 0])


@njit(cache=True, error_model="numpy")
def recall(z, start, motion):
    """Leave memories as their rates make them."""
