"""Sine and cosine without branches or calls, so that loops stay fast.

In a loop over lanes they become vector instructions. In a loop over samples all other numbers stay
in registers. Errors are within 2 units in the last place for |x| < 1e6. Beyond that they grow like
the spacing of floating-point numbers at x. From 4e15 on, where this spacing is a sixth of a turn,
the values are meaningless and may be large.

Reduction to [-pi/4, pi/4] after W. J. Cody and W. Waite, "Software Manual for the Elementary
Functions" (1980). There Taylor's series follows, whose next terms are below 5e-17.
"""

from numba import njit

# pi/2 in three parts: a product of the first or second with a number below 2**20 is exact.
HALF_PI_1 = 1.5707963267341256
HALF_PI_2 = 6.077100506303966e-11
HALF_PI_3 = 2.0222662487959506e-21

ROUND = 6755399441055744.0  # 1.5 * 2**52: added and taken away again, it rounds to an integer


@njit(error_model="numpy", fastmath={"contract"}, forceinline=True)
def quarter(x):
    """Sine and cosine of x minus its nearest quarter turn, and the quarter's number, -2 ... 2."""
    turns = (x * 0.6366197723675814 + ROUND) - ROUND
    r = ((x - turns * HALF_PI_1) - turns * HALF_PI_2) - turns * HALF_PI_3
    s = r * r
    s2 = s * s
    s4 = s2 * s2
    # Pairs of terms, and pairs of pairs, can be computed in parallel.
    sine = (-1.0 / 6.0 + s * (1.0 / 120.0)) + s2 * (-1.0 / 5040.0 + s * (1.0 / 362880.0))
    sine += s4 * ((-1.0 / 39916800.0 + s * (1.0 / 6227020800.0)) + s2 * (-1.0 / 1307674368000.0))
    cosine = (1.0 / 24.0 + s * (-1.0 / 720.0)) + s2 * (1.0 / 40320.0 + s * (-1.0 / 3628800.0))
    cosine += s4 * (
        (1.0 / 479001600.0 + s * (-1.0 / 87178291200.0)) + s2 * (1.0 / 20922789888000.0)
    )
    quarters = turns - 4.0 * ((0.25 * turns + ROUND) - ROUND)
    return r + r * s * sine, (1.0 - 0.5 * s) + s2 * cosine, quarters


@njit(error_model="numpy", fastmath={"contract"}, forceinline=True)
def sin(x):
    """Sine of x."""
    sine, cosine, quarters = quarter(x)
    size = cosine if abs(quarters) == 1.0 else sine
    return -size if (quarters < 0.0) | (quarters == 2.0) else size


@njit(error_model="numpy", fastmath={"contract"}, forceinline=True)
def cos(x):
    """Cosine of x."""
    sine, cosine, quarters = quarter(x)
    size = sine if abs(quarters) == 1.0 else cosine
    return -size if (quarters == 1.0) | (abs(quarters) == 2.0) else size
