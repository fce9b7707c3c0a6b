"""Rates of a model alone, under an input that is constant or linear over an interval."""

from collections import namedtuple
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from flexid.kernels.templates.generated import N_INPUTS, inlined, right_hand_side

# The input at the start of an interval and its change over it, coefficients, constants, and room.
Motion = namedtuple("Motion", "start change p c u")


@inlined
def rates_at(x, place, motion, rate):
    """Rates of x at a place within the interval."""
    for j in range(N_INPUTS):
        motion.u[j] = motion.start[j] + place * motion.change[j]
    right_hand_side(x, motion.u, motion.p, motion.c, rate)


@inlined
def recall(x, start, motion):
    """Leave memories as their rates make them."""
