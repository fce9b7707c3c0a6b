"""Differential equations with known solutions, as sources for the integrators."""

from types import ModuleType

import numpy as np
import sympy as sp
from numpy.typing import NDArray

from flexid.derivation.source import IMPORTS, assignments, function, unpack
from flexid.derivation.symbolic import symbol, to_sympy
from flexid.kernels.store import load_kernel, template

# As every lane of the explicit integrator wants rates; nothing is measured.
LANES = """
LANES = 2
N_PARAMETERS = N_OBSERVED = 1
N_INPUTS = N_COEFFICIENTS = 0
ROW_STARTS = (0,)


@njit(cache=True, error_model="numpy")
def lane_rates(w):
    z, p, dz = np.empty(SIZE), np.empty(1), np.empty(SIZE)
    for lane in range(LANES):
        p[0] = w[at(PARAMETERS, lane)]
        for i in range(SIZE):
            z[i] = w[at(STAGE + i, lane)]
        rates(w[at(STAGE_TIME, lane)], z, p, dz)
        for i in range(SIZE):
            w[at(RATES + i, lane)] = dz[i]


@njit(cache=True, error_model="numpy")
def lane_rates_and_outputs(w):
    lane_rates(w)
"""

Problem = tuple[str, ...]
"""Rates of z0, z1 ... at a time t, with a parameter p0."""

# z = (exp(sin t), cos(t) / (1 + t/2)): nonlinear, coupled and driven by time.
SMOOTH = (
    "cos(t)*z0 + z1**2 - cos(t)**2/(1 + t/2)**2",
    "-sin(t)/(1 + t/2) - z1/2/(1 + t/2) + z0**2 - exp(2*sin(t))",
)
PROTHERO_ROBINSON = ("-p0*(z0 - sin(t)) + cos(t)",)  # z = sin t whatever the stiffness p0
WALL = ("sqrt(1 - t)",)  # has no finite rate beyond t = 1


def smooth_solution(t: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solution of SMOOTH."""
    return np.array([np.exp(np.sin(t)), np.cos(t) / (1.0 + 0.5 * np.asarray(t))])


def integrator(problem: Problem, method: str = "rodas5p") -> ModuleType:
    """Compile the integrator for a problem."""
    z, t = [symbol(f"z{i}") for i in range(len(problem))], symbol("t")
    rates = [to_sympy(rate, {"t", "p0", *map(str, z)}) for rate in problem]
    given = unpack("z", z) + "\n    p0 = p[0]"
    of_rates = {f"dz[{i}]": rate for i, rate in enumerate(rates)}
    slopes = {f"slope[{i}]": sp.diff(rate, t) for i, rate in enumerate(rates)}
    slopes |= {
        f"jacobian[{i}, {j}]": sp.diff(rate, by)
        for i, rate in enumerate(rates)
        for j, by in enumerate(z)
    }
    both = of_rates | slopes
    source = [
        f"{IMPORTS}\nimport numpy as np\nfrom numba import njit\n\nSIZE = {len(z)}\n",
        function("rates(t, z, p, dz)", "Rates.", given, assignments([*of_rates], rates)),
        function(
            "rates_and_jacobian(t, z, p, dz, jacobian, slope)",
            "The same, and their derivatives.",
            given,
            assignments([*both], [*both.values()]),
        ),
        function(
            "observe(t, weight, z, p, totals)", "A mean.", "    totals[0] += weight * z[0]**2"
        ),
    ]
    lanes = [LANES, template("loop_measures")] if method == "dopri5" else []
    text = "\n\n".join((*source, template("run_status"), *lanes, template(method)))
    return load_kernel("test_problem", [text], lambda: text)


def integrate(
    kernel: ModuleType,
    stop: float,
    start: list[float],
    stiffness: float = 0.0,
    relative: float = 1e-6,
    absolute: float = 1e-9,
    longest_step: float = 1.0,
    most_steps: int = 100_000,
    sample_time: float = 1.0,
    samples: int = 0,
) -> tuple[int, float, NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Integrate from 0; return status, time reached, state, samples and counts."""
    z = np.array([start])
    table = np.empty((1, samples, kernel.SIZE))
    counts = np.zeros((1, 3), dtype=np.int64)
    status, reached = np.zeros(1, dtype=np.int64), np.zeros(1)
    first_step = min(1e-3, longest_step) if relative < 1.0 else longest_step
    kernel.integrate(
        (0.0, stop),
        z,
        np.array([[stiffness]]),
        (relative, absolute, first_step, longest_step, 1e12, most_steps),
        (sample_time, table),
        np.empty((1, 0)),
        (status, reached, counts),
    )
    return int(status[0]), float(reached[0]), z[0], table[0], counts[0]
