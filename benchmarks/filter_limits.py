"""Fastest and slowest useful filter rates, over the sampling rate.

``python -m benchmarks.filter_limits``: the joint of Huang (2003), 30 s, from encoders with white
noise. It prints the largest relative error of a coefficient by recursive least squares, and the
share of 95 % intervals that contain the truth, over seeds; then the effect of single precision.
"""

import numpy as np
from numba import njit

from benchmarks.report import markdown
from benchmarks.size import sized
from flexid.arrays import FloatArray
from flexid.estimators.recursive_least_squares import recursive_least_squares
from flexid.identification.vocabulary.evidence import quantile
from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run

TRUTH = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
SYSTEM = flexible_joint(("gravity", "motor_viscous"))
PRODUCTS = sized((0.005, 0.02, 0.125, 0.25, 0.5, 1.0, 2.0), (0.125,))
NOISE = 1e-4  # rad
SEEDS = sized(8, 1)
_DURATION, _STEP = 30.0, 1e-3  # s
_SLOW = sized((1e-3, 1e-4, 1e-5, 1e-6), (1e-3,))


def motion(h: float) -> FloatArray:
    """Return link, motor and piecewise linear torque, shape (n, 3), every h seconds."""
    time = h * np.arange(round(_DURATION / h) + 1)
    u = 20.0 * np.sin(2.0 * time) + 10.0 * np.sin(5.3 * time) + 5.0 * np.sin(13.0 * time)
    fine = round(h / _STEP)
    between = _STEP * np.arange(fine * (len(time) - 1) + 1)
    states = free_run(SYSTEM, TRUTH, np.zeros(4), np.interp(between, time, u)[:, None], _STEP)
    return np.column_stack((states[::fine, 0], states[::fine, 2], u))


def errors(rows: FloatArray, h: float, rate: float, noise: float) -> tuple[float, float]:
    """Return the largest relative error, mean over seeds, and the share of correct intervals."""
    estimator = recursive_least_squares(SYSTEM, h, rate, "linear")
    truth = np.array([TRUTH[name] for name in SYSTEM.coefficients])
    worst, held = [], []
    for seed in range(SEEDS if noise else 1):
        noisy = rows.copy()
        noisy[:, :2] += noise * np.random.default_rng(seed).standard_normal((len(rows), 2))
        state = estimator.replay(estimator.init({}), noisy).state
        found, (covariance, freedom) = estimator.coefficients(state), estimator.covariance(state)
        widths = np.array([quantile(nu) for nu in freedom]) * np.sqrt(np.diag(covariance))
        worst.append(np.max(np.abs(found / truth - 1.0)))
        held.append(np.mean(np.abs(found - truth) <= widths))
    return float(np.mean(worst)), float(np.mean(held))


@njit
def _filtered(values, pole, one):
    once = twice = one - one
    passed = np.empty_like(values)
    for i in range(len(values)):
        once = pole * once + (one - pole) * values[i]
        twice = pole * twice + (one - pole) * once
        passed[i] = twice
    return passed


def rounding(product: float) -> float:
    """Return the RMS error of single precision in the filter, over the RMS of its output."""
    phase = product * np.arange(min(int(60.0 / product), 20_000_000))
    values = (np.sin(0.7 * phase) + 0.5 * np.sin(2.1 * phase) + 0.3).astype(np.float32)
    pole = np.float32(np.exp(-product))
    single = _filtered(values, pole, np.float32(1.0)).astype(np.float64)
    double = _filtered(values.astype(np.float64), float(pole), 1.0)
    late = slice(len(values) // 3, None)
    return float(np.sqrt(np.mean((single - double)[late] ** 2)) / np.std(double[late]))


def main() -> None:
    """Print the tables."""
    for h in (1e-3, 1e-2):
        rows = motion(h)
        lines = []
        for product in PRODUCTS:
            clean, _ = errors(rows, h, product / h, 0.0)
            worst, held = errors(rows, h, product / h, NOISE)
            lines.append((f"{product:g}", f"{clean:.4%}", f"{worst:.3%}", f"{held:.0%}"))
        heads = ("λh", "without noise", f"{NOISE:g} rad", "intervals that hold")
        print(f"\nSamples every {1e3 * h:g} ms\n", *markdown(heads, lines), sep="\n")
    slow = [(f"{product:g}", f"{rounding(product):.0e}") for product in _SLOW]
    print("", *markdown(("λh", "rounding in single precision"), slow), sep="\n")


if __name__ == "__main__":
    main()
