"""Closed loop of Table I with SciPy's Radau and CasADi's CVODES, as a user would write it."""

import math
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.size import sized
from benchmarks.table1 import Exponents, Table1

DURATION = sized(30.0, 0.2)
MOST_STEPS = 10_000_000

Solver = Callable[[], list[float]]
"""Function that solves once and returns the four final parameter errors."""


class GaveUpError(RuntimeError):
    """A solver failed."""


def radau(exponents: Exponents, plain: bool, tolerance: float) -> Solver:
    """Build SciPy's Radau with its default Jacobian by finite differences."""
    loop = Table1(exponents)
    rates = loop.plain_rates if plain else loop.error_rates
    start = loop.plain_start() if plain else loop.error_start()

    def solve() -> list[float]:
        result = solve_ivp(
            lambda t, state: rates(t, state.tolist()),
            (0.0, DURATION),
            start,
            method="Radau",
            t_eval=[DURATION],
            rtol=tolerance,
            atol=1e-3 * tolerance,
        )
        if not result.success:
            raise GaveUpError(result.message)
        last = result.y[:, -1].tolist()
        return loop.plain_errors(last) if plain else last[4:]

    return solve


def cvodes(exponents: Exponents, plain: bool, tolerance: float, compiled: bool = False) -> Solver:
    """Build CasADi's CVODES with exact Jacobian.

    Parameters
    ----------
    exponents, plain, tolerance
        As for `radau`.
    compiled : bool, optional
        Compile CasADi's functions as C with -O3; by default they run in its virtual
        machine.
    """
    import casadi  # of the extra "benchmarks"

    symbolic = Table1(exponents, casadi.sin, casadi.cos)
    time, state = casadi.SX.sym("t"), casadi.SX.sym("z", 8)
    rates = symbolic.plain_rates if plain else symbolic.error_rates
    options = {"reltol": tolerance, "abstol": 1e-3 * tolerance, "max_num_steps": MOST_STEPS}
    if compiled:
        options |= {"jit": True, "compiler": "shell", "jit_options": {"flags": ["-O3"]}}
    problem = {"x": state, "t": time, "ode": casadi.vertcat(*rates(time, casadi.vertsplit(state)))}
    integrator = casadi.integrator("loop", "cvodes", problem, 0.0, DURATION, options)
    loop = Table1(exponents, math.sin, math.cos)
    start = loop.plain_start() if plain else loop.error_start()

    def solve() -> list[float]:
        try:
            last = np.asarray(integrator(x0=start)["xf"]).ravel().tolist()
        except RuntimeError as error:
            reason = str(error).rpartition('returned "')[2].partition('"')[0]
            raise GaveUpError(reason) from None
        return loop.plain_errors(last) if plain else last[4:]

    return solve
