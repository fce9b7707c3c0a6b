"""How finely the classical Runge-Kutta method must divide a sampling interval."""

from types import ModuleType

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SimulationError

STEPS_PER_TIME_CONSTANT = 20.0
"""Steps of the integrator per time constant of the fastest pole; it then errs by 3e-9 per step."""

_MOST_SUBSTEPS = 1000  # per sample


def runge_kutta_substeps(
    kernel: ModuleType,
    x: FloatArray,
    u: FloatArray,
    p: FloatArray,
    c: FloatArray,
    sample_time: float,
) -> int:
    """Steps per sample that resolve a model's fastest pole."""
    fastest = fastest_pole(kernel, x, u, p, c)
    substeps = max(1.0, np.ceil(STEPS_PER_TIME_CONSTANT * fastest * sample_time))
    if substeps > _MOST_SUBSTEPS:
        raise SimulationError(
            f"the model has a pole of {fastest:.3g} 1/s, too fast for samples {sample_time:.3g} s "
            f"apart: check its coefficients",
            0.0,
        )
    return int(substeps)


def fastest_pole(
    kernel: ModuleType, x: FloatArray, u: FloatArray, p: FloatArray, c: FloatArray
) -> float:
    """Largest magnitude of a model's poles in 1/s, at the start and at rest."""
    # Smoothed friction is steepest at rest, a hardening spring where the motion starts.
    points = [np.zeros_like(x), x] if np.any(x) else [x]
    return max(_fastest_rate(kernel, at, u, p, c) for at in points)


def _fastest_rate(
    kernel: ModuleType, x: FloatArray, u: FloatArray, p: FloatArray, c: FloatArray
) -> float:
    """Largest magnitude of the poles of the model linearised about a state, in 1/s."""
    matrix, jumps = np.empty((len(x), len(x))), np.empty(len(x) // 2)
    kernel.linearised(x, u, p, c, matrix, jumps)
    for row in np.flatnonzero(jumps).tolist():
        raise SimulationError(
            f"the acceleration of the model's row {row + 1} jumps with the sign of its velocity: "
            f"smooth it, for example tanh(v/0.01) instead of sign(v)",
            0.0,
        )
    if not np.all(np.isfinite(matrix)):  # the model has no linearisation here
        return 0.0
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))
