"""Differential equations with known solutions, as sources for the integrators."""

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from flexid.kernels.store import load_kernel, template

HEAD = """
from math import cos, exp, sin, sqrt

import numpy as np
from numba import njit

SIZE = {size}


@njit(cache=True, error_model="numpy")
def rates(t, z, p, dz):
{rates}


@njit(cache=True, error_model="numpy")
def rates_and_jacobian(t, z, p, dz, jacobian, slope):
    rates(t, z, p, dz)
{jacobian}


@njit(cache=True, error_model="numpy")
def observe(t, weight, z, p, totals):
    totals[0] += weight * z[0] ** 2

"""

# The same as every lane of the explicit integrator wants it; nothing is measured.
LANES = """

LANES = 2
N_PARAMETERS = 1
N_MEASURES = 0
N_OBSERVED = 0


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


@njit(cache=True, error_model="numpy")
def lane_measures(w):
    pass

"""

# z = (exp(sin t), cos(t) / (1 + t/2)): nonlinear, coupled and driven by time.
SMOOTH = (
    """
    dz[0] = cos(t) * z[0] + z[1] ** 2 - cos(t) ** 2 / (1.0 + 0.5 * t) ** 2
    dz[1] = -sin(t) / (1.0 + 0.5 * t) - 0.5 * z[1] / (1.0 + 0.5 * t) + z[0] ** 2 - exp(2.0 * sin(t))
""",
    """
    a = 1.0 + 0.5 * t
    jacobian[0, 0] = cos(t)
    jacobian[0, 1] = 2.0 * z[1]
    jacobian[1, 0] = 2.0 * z[0]
    jacobian[1, 1] = -0.5 / a
    slope[0] = -sin(t) * z[0] + 2.0 * cos(t) * sin(t) / a**2 + cos(t) ** 2 / a**3
    slope[1] = (-cos(t) / a + 0.5 * sin(t) / a**2 + 0.25 * z[1] / a**2
                - 2.0 * cos(t) * exp(2.0 * sin(t)))
""",
)

# Prothero and Robinson: z = sin t whatever the stiffness p[0].
PROTHERO_ROBINSON = (
    "    dz[0] = -p[0] * (z[0] - sin(t)) + cos(t)",
    "    jacobian[0, 0] = -p[0]\n    slope[0] = p[0] * cos(t) - sin(t)",
)

# Van der Pol's oscillator in its slow time, stiffness p[0].
VAN_DER_POL = (
    "    dz[0] = z[1]\n    dz[1] = p[0] * ((1.0 - z[0] ** 2) * z[1] - z[0])",
    """
    jacobian[0, 0] = 0.0
    jacobian[0, 1] = 1.0
    jacobian[1, 0] = p[0] * (-2.0 * z[0] * z[1] - 1.0)
    jacobian[1, 1] = p[0] * (1.0 - z[0] ** 2)
    slope[:] = 0.0
""",
)

# z' = z², which leaves every bound at t = 1/z(0).
EXPLOSION = ("    dz[0] = z[0] ** 2", "    jacobian[0, 0] = 2.0 * z[0]\n    slope[0] = 0.0")

# Has no finite rate beyond t = 1.
WALL = (
    "    dz[0] = sqrt(1.0 - t)",
    "    jacobian[0, 0] = 0.0\n    slope[0] = -0.5 / sqrt(1.0 - t)",
)


def smooth_solution(t: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solution of SMOOTH."""
    return np.array([np.exp(np.sin(t)), np.cos(t) / (1.0 + 0.5 * np.asarray(t))])


def integrator(problem: tuple[str, str], size: int, method: str = "rodas5p") -> ModuleType:
    """Compile the integrator for a problem."""
    source = HEAD.format(size=size, rates=problem[0], jacobian=problem[1])
    templates = ["run_status", method]
    if method == "dopri5":
        source += LANES
        templates.insert(1, "lanes")
    text = "\n\n".join((source, *map(template, templates)))
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
