"""How finely the classical Runge-Kutta method must divide a sampling interval."""

from types import ModuleType

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SimulationError
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem

STEPS_PER_TIME_CONSTANT = 20.0
"""Steps of the integrator per time constant of the fastest pole; it then errs by 3e-9 per step."""

_MOST_SUBSTEPS = 1000  # per sample


def runge_kutta_substeps(
    system: ParametricSystem,
    x: FloatArray,
    u: FloatArray,
    p: FloatArray,
    c: FloatArray,
    sample_time: float,
) -> int:
    """Steps per sample that resolve a model's fastest pole."""
    fastest = fastest_pole(system, x, u, p, c)
    substeps = max(1.0, np.ceil(STEPS_PER_TIME_CONSTANT * fastest * sample_time))
    if substeps > _MOST_SUBSTEPS:
        raise SimulationError(
            f"the model has a pole of {fastest:.3g} 1/s, too fast for samples {sample_time:.3g} s "
            f"apart: check its coefficients",
            0.0,
        )
    return int(substeps)


def fastest_pole(
    system: ParametricSystem, x: FloatArray, u: FloatArray, p: FloatArray, c: FloatArray
) -> float:
    """Largest magnitude of a model's poles in 1/s, at the start and at rest."""
    model = plain_model(system)
    # Smoothed friction is steepest at rest, a hardening spring where the motion starts.
    points = [np.zeros_like(x), x] if np.any(x) else [x]
    return max(_fastest_rate(model, at, u, p, c) for at in points)


def _fastest_rate(
    model: ModuleType, x: FloatArray, u: FloatArray, p: FloatArray, c: FloatArray
) -> float:
    """Largest magnitude of the poles of the model linearised about a state, in 1/s."""
    matrix, gains = np.empty((len(x), len(x))), np.empty((len(x), len(u)))
    jumps = np.empty(len(x) // 2)
    with np.errstate(all="ignore"):
        model.slopes(x, u, p, c, matrix, gains)
        model.jumps(x, u, p, c, jumps)
    for row in np.flatnonzero(jumps).tolist():
        raise SimulationError(
            f"the acceleration of the model's row {row + 1} jumps with the sign of its velocity: "
            f"smooth it, for example tanh(v/0.01) instead of sign(v)",
            0.0,
        )
    if not np.all(np.isfinite(matrix)):  # the model has no linearisation here
        return 0.0
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))


def plain_model(system: ParametricSystem) -> ModuleType:
    """``right_hand_side``, ``slopes`` and ``jumps`` of a system, as Python."""

    def build() -> str:
        from flexid.derivation.model_functions import plain_model as source

        return source(system)

    return load_kernel("plain_model", [system.digest], build)
