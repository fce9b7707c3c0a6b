"""The integrators, and our own sine and cosine, against theory, known solutions and SciPy."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest
import sympy as sp
from numpy.typing import NDArray

from flexid.derivation.source import IMPORTS, assignments, function, unpack
from flexid.derivation.symbolic import symbol, to_sympy
from flexid.kernels.store import load_kernel, template

# The rates as the explicit integrator requires them for each lane; no measurement.
LANES = """
LANES = 2
N_PARAMETERS = N_OBSERVED = 1
N_INPUTS = N_COEFFICIENTS = 0
ROW_STARTS = (0,)


@njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def lane_rates(w):
    z, p, dz = np.empty(SIZE), np.empty(1), np.empty(SIZE)
    for lane in range(LANES):
        p[0] = w[at(PARAMETERS, lane)]
        for i in range(SIZE):
            z[i] = w[at(STAGE + i, lane)]
        rates(w[at(STAGE_TIME, lane)], z, p, dz)
        for i in range(SIZE):
            w[at(RATES + i, lane)] = dz[i]


@njit(error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
def lane_rates_and_outputs(w):
    lane_rates(w)
"""

Problem = tuple[str, ...]
"""Rates of z0, z1 ... at a time t, with a parameter p0."""

# z = (exp(sin t), cos(t) / (1 + t/2), p0 ...): nonlinear, coupled and driven by time. The rate of
# the last state is not finite beyond t = 3/2.
SMOOTH = (
    "cos(t)*z0 + z1**2 - cos(t)**2/(1 + t/2)**2",
    "-sin(t)/(1 + t/2) - z1/2/(1 + t/2) + z0**2 - exp(2*sin(t))",
    "p0*sqrt(3/2 - t)",
)
START = [1.0, 1.0, 0.0]
PROTHERO_ROBINSON = ("-p0*(z0 - sin(t)) + cos(t)",)  # z = sin t for any stiffness p0


def smooth_solution(t: float | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the solution of SMOOTH with p0 = 0."""
    return np.array([np.exp(np.sin(t)), np.cos(t) / (1.0 + 0.5 * np.asarray(t)), 0.0 * t])


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


USUAL = {"relative": 1e-6, "absolute": 1e-9, "longest": 1.0, "sample_time": 1.0, "samples": 0}


def integrate(kernel: ModuleType, stop: float, start: list[float], p0: float = 0.0, **chosen: Any):
    """Integrate from 0; return status, time reached, state, samples and counts."""
    relative, absolute, longest, sample_time, samples = (USUAL | chosen).values()
    z, table = np.array([start]), np.empty((1, samples, kernel.SIZE))
    status, reached = np.zeros(1, dtype=np.int64), np.zeros(1)
    counts = np.zeros((1, 3), dtype=np.int64)
    first = min(1e-3, longest) if relative < 1.0 else longest
    limits = (relative, absolute, first, longest, 1e12, 100_000)
    sampled, results = (sample_time, table), (status, reached, counts)
    kernel.integrate((0.0, stop), z, np.array([[p0]]), limits, sampled, np.empty((1, 0)), results)
    return int(status[0]), float(reached[0]), z[0], table[0], counts[0]


STEPS = 2.0 ** -np.arange(3, 8)
FIXED = 1e9  # a relative tolerance that accepts every step, so that all have the maximum length

both = pytest.mark.parametrize("method", ["rodas5p", "dopri5"])


def slope(steps: np.ndarray, errors: list[float]) -> float:
    """Return the fitted order of convergence."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


@pytest.mark.parametrize(
    ("method", "least", "first"),
    [("rodas5p", 4.8, 0), ("dopri5", 4.7, 2)],  # its longest steps show the next order too
)
def test_order_is_five(method: str, least: float, first: int) -> None:
    """Assert fifth order at the end of the interval."""
    kernel = integrator(SMOOTH, method)
    errors = []
    for step in STEPS[first:]:
        _, _, z, _, counts = integrate(kernel, 1.0, START, relative=FIXED, longest=step)
        assert counts[0] == round(1.0 / step)
        errors.append(float(np.max(np.abs(z - smooth_solution(1.0)))))
    assert least < slope(STEPS[first:], errors) < 5.3


@pytest.mark.parametrize("stiffness", [1e2, 1e5, 1e8])
def test_no_order_reduction_that_hurts(stiffness: float) -> None:
    """Assert that Prothero and Robinson's problem needs few steps for any stiffness."""
    kernel = integrator(PROTHERO_ROBINSON)
    status, _, z, _, counts = integrate(kernel, 10.0, [0.0], stiffness)
    assert status == kernel.FINISHED
    assert abs(z[0] - np.sin(10.0)) < 1e-5
    assert counts[0] < 300


@both
def test_tolerances_and_ends(method: str) -> None:
    """Assert errors near the tolerance, and the end where rates become undefined."""
    kernel = integrator(SMOOTH, method)
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10):
        z = integrate(kernel, 1.0, START, relative=tolerance, absolute=tolerance)[2]
        assert np.max(np.abs(z - smooth_solution(1.0))) < 10.0 * tolerance
    kernel = integrator(SMOOTH, method)
    status, reached, *_ = integrate(kernel, 2.0, START, 1.0)
    assert status in (kernel.NOT_FINITE, kernel.STEP_TOO_SMALL)
    assert reached == pytest.approx(1.5, abs=1e-3)


def test_dense_output() -> None:
    """Assert fourth order between the steps, and samples at both ends exactly."""
    kernel = integrator(SMOOTH)
    errors = []
    times = np.arange(1001) / 1000.0
    for step in STEPS:
        chosen = {"longest": step, "sample_time": 1e-3, "samples": len(times)}
        samples = integrate(kernel, 1.0, START, relative=FIXED, **chosen)[3]
        errors.append(float(np.max(np.abs(samples - smooth_solution(times).T))))
    assert 3.9 < slope(STEPS, errors) < 5.1
    kernel = integrator(SMOOTH)
    _, _, z, samples, counts = integrate(kernel, 3 * 0.1, START, sample_time=0.1, samples=4)
    assert counts[2] == 4
    assert samples[0].tolist() == START
    assert samples[-1] == pytest.approx(z, rel=1e-12)


SOURCE = """
import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def both(x, sines, cosines):
    for i in range(x.size):
        sines[i] = sin(x[i])
        cosines[i] = cos(x[i])
"""


@pytest.fixture(scope="module")
def kernel() -> ModuleType:
    """Return a loop that computes sine and cosine of each number."""
    return load_kernel("test_sin_cos", [SOURCE], lambda: SOURCE, ["sin_cos"])


@pytest.mark.parametrize("largest", [1e-3, 1.0, 100.0, 1e6])
def test_error_is_two_units_in_the_last_place(kernel: ModuleType, largest: float) -> None:
    """Assert an error of 2 units in the last place, near multiples of pi/2 as well."""
    generator = np.random.default_rng(3)
    drawn = generator.uniform(-largest, largest, 100_000)
    quarters = np.arange(-int(largest), int(largest), max(1, int(largest) // 5000))
    x = np.concatenate([drawn, quarters * (np.pi / 2.0)])
    sines, cosines = np.empty_like(x), np.empty_like(x)
    kernel.both(x, sines, cosines)
    for own, right in ((sines, np.sin(x)), (cosines, np.cos(x))):
        assert np.max(np.abs(own - right) / np.spacing(np.abs(right))) <= 3.0  # NumPy's error is 1


def test_what_is_no_number_stays_none(kernel: ModuleType) -> None:
    """Assert that infinities and NaN give NaN, and zero its exact values."""
    x = np.array([np.inf, -np.inf, np.nan, 0.0])
    sines, cosines = np.empty_like(x), np.empty_like(x)
    kernel.both(x, sines, cosines)
    assert np.isnan(sines[:3]).all()
    assert np.isnan(cosines[:3]).all()
    assert (sines[3], cosines[3]) == (0.0, 1.0)
