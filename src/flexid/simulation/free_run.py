"""Poles of a model, and its free run under a recorded input."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from flexid.arrays import FloatArray
from flexid.errors import SimulationError
from flexid.kernels.store import load_kernel, model_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

STEPS_PER_TIME_CONSTANT = 20.0
"""Integration steps per time constant of the fastest pole; the error is 3e-9 per step."""

_MOST_SUBSTEPS = 1000  # per sample


def runge_kutta_substeps(
    system: ParametricSystem,
    x: FloatArray,
    u: FloatArray,
    p: FloatArray,
    c: FloatArray,
    sample_time: float,
) -> int:
    """Return the integration steps per sample that resolve a model's fastest pole."""
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
    """Return the largest magnitude of the poles in 1/s, linearised at the start and at rest."""
    model, fastest = model_kernel("plain_model", system), 0.0
    # Smoothed friction is steepest at rest, a hardening spring where the motion starts.
    for at in [np.zeros_like(x), x] if np.any(x) else [x]:
        matrix, gains = np.empty((len(x), len(x))), np.empty((len(x), len(u)))
        jumps = np.empty(len(x) // 2)
        with np.errstate(all="ignore"):
            model.slopes(at, u, p, c, matrix, gains)
            model.jumps(at, u, p, c, jumps)
        for row in np.flatnonzero(jumps).tolist():
            raise SimulationError(
                f"the acceleration of the model's row {row + 1} jumps with the sign of its "
                f"velocity: smooth it, for example tanh(v/0.01) instead of sign(v)",
                0.0,
            )
        if np.all(np.isfinite(matrix)):  # else the model has no linearisation here
            fastest = max(fastest, float(np.max(np.abs(np.linalg.eigvals(matrix)))))
    return fastest


def free_run(
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    initial_state: ArrayLike,  # (n_states,)
    inputs: ArrayLike,  # (n,) or (n, n_inputs)
    sample_time: float,  # s
    hold: Hold = "linear",  # or "zero"
) -> FloatArray:
    """Simulate a model under a recorded input; return its states, shape (n, n_states)."""
    u = np.ascontiguousarray(inputs, dtype=float).reshape(len(np.asarray(inputs)), -1)
    x = np.asarray(initial_state, dtype=float)
    p = np.array([coefficients[name] for name in system.coefficients])
    c = np.array(list(system.constants.values()), dtype=float)
    substeps = runge_kutta_substeps(system, x, u[0], p, c, sample_time)
    states = np.empty((len(u), len(x)))
    run = load_kernel("free_run", (), None, ["free_run"]).free_run
    address = model_kernel("rates", system).right_hand_side.address
    written = run(address, x, u, p, c, sample_time, hold == "zero", substeps, states)
    if written < len(states):
        raise SimulationError(
            "the free run of the model diverges: its coefficients make it unstable",
            written * sample_time,
        )
    return states
