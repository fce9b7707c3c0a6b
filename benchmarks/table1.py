"""Closed loop of Huang (2003), Table I, written by hand as by a user of another tool.

It takes plain floats, returns a list of rates and uses nothing of flexid. SciPy evaluates it with
the functions of `math`, CasADi with its own.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

Exponents = tuple[int, int, int]
Function = Callable[[Any], Any]

MGL, JL, JR, MU, KE = 5.0, 1.0, 0.3, 0.1, 100.0
MGL_N, JL_N, JR_N, MU_N, KE_N = 4.5, 0.8, 0.18, 0.07, 75.0
JL_MAX, JR_MAX, KE_MIN = 1.4, 0.42, 60.0
AMPLITUDE, OMEGA, K, C1, C2 = 3.0, 5.0, 50.0, 1.0, 1.0
TRUE = (MGL / JL, KE / JL, KE / JR, MU / JR)
START = (2.5, 50.0, 166.7, 0.167)


class Table1:
    """Equations of one reading of the feedback gains, in two sets of coordinates.

    Parameters
    ----------
    exponents : (int, int, int)
        Powers of k in the three gains.
    sin, cos : callable, optional
        Functions for the type on which the equations are evaluated.
    k : float, optional
        Attenuation.
    true : sequence of float, optional
        theta1, theta2, alpha1, alpha2 of the plant.
    beta1 : float, optional
        Input gain of the plant.
    """

    def __init__(
        self,
        exponents: Exponents,
        sin: Function = math.sin,
        cos: Function = math.cos,
        k: float = K,
        true: Sequence[float] = TRUE,
        beta1: float = 1 / JR,
    ):
        a, b, c = exponents
        self.gain1, self.gain2, self.gain3 = k**a * JL_MAX / KE_MIN, k**b * 1.0, k**c * JR_MAX
        self.k, self.true, self.beta1 = k, tuple(true), beta1
        self.sin, self.cos = sin, cos

    def nominal(self, t: Any) -> tuple[Any, ...]:
        """Return q_d, q̇_d, q̈_d, w1N, w2N, ẇ2N and u_N of eq. (11)."""
        sin, cos = self.sin, self.cos
        q, q1 = AMPLITUDE * sin(OMEGA * t), AMPLITUDE * OMEGA * cos(OMEGA * t)
        q2, q3, q4 = -(OMEGA**2) * q, -(OMEGA**2) * q1, OMEGA**4 * q
        w1 = q + (MGL_N * sin(q) + JL_N * q2) / KE_N
        w2 = q1 + (MGL_N * cos(q) * q1 + JL_N * q3) / KE_N
        w2_rate = q2 + (MGL_N * (q2 * cos(q) - q1 * q1 * sin(q)) + JL_N * q4) / KE_N
        return q, q1, q2, w1, w2, w2_rate, JR_N * w2_rate + MU_N * w2 + KE_N * (w1 - q)

    def plain_rates(self, t: Any, state: Any) -> list[Any]:
        """Return the rates of x1 ... x4, y1, y2, z1, z2: eqs. (4) and (6) as printed."""
        x1, x2, x3, x4, y1, y2, z1, z2 = state
        q, q1, _, w1, w2, _, u_nominal = self.nominal(t)
        filtered_error = x2 - q1 + self.k * (x1 - q)
        w2_total = w2 - self.gain2 * (x3 - w1 + self.gain1 * filtered_error)
        u = u_nominal - self.gain3 * (x4 - w2_total)
        sine, cosine, twist = self.sin(x1), self.cos(x1), x1 - x3
        theta1, theta2 = y1 - C1 * x2 * sine, y2 - C1 * twist * x2
        alpha1, alpha2 = z1 + C2 * twist * x4, z2 - C2 * x4 * x4 / 2
        s = theta1 * sine + theta2 * twist
        r = alpha1 * twist - alpha2 * x4 + self.beta1 * u
        return [
            x2,
            -self.true[0] * sine - self.true[1] * twist,
            x4,
            self.true[2] * twist - self.true[3] * x4 + self.beta1 * u,
            -C1 * (sine * s - x2 * x2 * cosine),
            -C1 * (twist * s - (x2 - x4) * x2),
            -C2 * (twist * r + (x2 - x4) * x4),
            C2 * x4 * r,
        ]

    def plain_start(self) -> list[float]:
        """Return the initial state: x(0) = 0, so the observer's states equal the estimates."""
        return [0.0, 0.0, 0.0, 0.0, *START]

    def plain_errors(self, state: Any) -> list[float]:
        """Return the parameter errors p̂ - p for a state in plain coordinates."""
        x1, x2, x3, x4, y1, y2, z1, z2 = map(float, state)
        twist = x1 - x3
        estimates = (
            y1 - C1 * x2 * math.sin(x1),
            y2 - C1 * twist * x2,
            z1 + C2 * twist * x4,
            z2 - C2 * x4 * x4 / 2,
        )
        return [estimate - true for estimate, true in zip(estimates, self.true, strict=True)]

    def error_rates(self, t: Any, state: Any) -> list[Any]:
        """Return the rates of x1 - q_d, ẽ2, x3 - w1, x4 - w2 and the parameter errors, eq. (7)."""
        e1, e2, e3, e4, theta1, theta2, alpha1, alpha2 = state
        q, _, q2, w1, w2, w2_rate, u_nominal = self.nominal(t)
        sine, twist = self.sin(q + e1), q + e1 - (w1 - self.gain1 * e2 + e3)
        x4 = w2 - self.gain2 * e3 + e4
        e1_rate = e2 - self.k * e1
        e2_rate = -self.true[0] * sine - self.true[1] * twist - q2 + self.k * e1_rate
        e3_rate = e4 - self.gain2 * e3 + self.gain1 * e2_rate
        x4_rate = (
            self.true[2] * twist - self.true[3] * x4 + self.beta1 * (u_nominal - self.gain3 * e4)
        )
        link, motor = C1 * (theta1 * sine + theta2 * twist), C2 * (alpha1 * twist - alpha2 * x4)
        return [
            e1_rate,
            e2_rate,
            e3_rate,
            x4_rate - w2_rate + self.gain2 * e3_rate,
            -sine * link,
            -twist * link,
            -twist * motor,
            x4 * motor,
        ]

    def error_start(self) -> list[float]:
        """Return the initial state in error coordinates, as floats."""
        _, _, _, w1, w2, _, _ = self.nominal(0.0)
        e2 = -AMPLITUDE * OMEGA
        e3 = -(w1 - self.gain1 * e2)
        e4 = -(w2 - self.gain2 * e3)
        return [0.0, e2, e3, e4, *(s - p for s, p in zip(START, self.true, strict=True))]
