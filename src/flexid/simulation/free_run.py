"""Free run: the model alone, from an initial state, under a recorded input."""

from collections.abc import Mapping
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexid.errors import SimulationError
from flexid.kernels.store import load_kernel, template
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_STEPS_PER_TIME_CONSTANT = 20.0  # of the fastest pole; RK4 then errs by 3e-9 per step
_MOST_SUBSTEPS = 1000  # per sample
_NUDGE = 1e-6  # rad or rad/s, for the differences of the linearisation


def free_run(
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    initial_state: ArrayLike,
    inputs: ArrayLike,
    sample_time: float,
    hold: Hold = "linear",
) -> NDArray[np.float64]:
    """Simulate the model from an initial state with a recorded input only.

    Parameters
    ----------
    system : ParametricSystem
        The model; its constants have the values declared in it.
    coefficients : mapping of str to float
        A value for each of the system's coefficients.
    initial_state : (n_states,) array_like
        State at the first sample.
    inputs : (n,) or (n, n_inputs) array_like
        The recorded input.
    sample_time : float
        Seconds between samples.
    hold : {"zero", "linear"}, optional
        Behaviour of the input between samples.

    Returns
    -------
    (n, n_states) ndarray
        The states at the samples.

    Raises
    ------
    SimulationError
        If the motion grows beyond all bounds, or the model is far too fast for the sample time.
    """
    u = np.ascontiguousarray(inputs, dtype=float).reshape(len(np.asarray(inputs)), -1)
    p = np.array([coefficients[name] for name in system.coefficients])
    c = np.array(list(system.constants.values()), dtype=float)
    out = np.empty((len(u), len(system.states)))
    x0 = np.asarray(initial_state, dtype=float)
    held = int(hold == "zero")
    kernel = free_run_kernel(system)
    # Smoothed friction is steepest at rest, a hardening spring where the motion starts.
    fastest = max(_fastest_rate(kernel, x, u[0], p, c) for x in (np.zeros_like(x0), x0))
    substeps = max(1.0, np.ceil(_STEPS_PER_TIME_CONSTANT * fastest * sample_time))
    if substeps > _MOST_SUBSTEPS:
        raise SimulationError(
            f"the model has a pole of {fastest:.3g} 1/s, too fast for samples {sample_time:.3g} s "
            f"apart: check its coefficients",
            0.0,
        )
    written = kernel.free_run(x0, u, p, c, sample_time, held, int(substeps), out)
    if written < len(u):
        raise SimulationError(
            "the free run of the model diverges: its coefficients make it unstable",
            written * sample_time,
        )
    return out


def _fastest_rate(
    kernel: ModuleType,
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    p: NDArray[np.float64],
    c: NDArray[np.float64],
) -> float:
    """Largest magnitude of the poles of the model linearised about a state, in 1/s."""
    rates = np.empty((2, len(x), len(x)))
    for side, nudge in enumerate((_NUDGE, -_NUDGE)):
        for place in range(len(x)):
            nudged = x.copy()
            nudged[place] += nudge
            kernel.right_hand_side(nudged, u, p, c, rates[side, place])
    jacobian = (rates[0] - rates[1]) / (2.0 * _NUDGE)
    if not np.all(np.isfinite(jacobian)):  # the model has no linearisation here
        return 0.0
    return float(np.max(np.abs(np.linalg.eigvals(jacobian))))


def free_run_kernel(system: ParametricSystem) -> ModuleType:
    """Compiled module with ``right_hand_side`` and ``free_run`` of a system."""

    def build() -> str:
        from flexid.derivation.model_functions import model_functions

        return model_functions(system, "Free run") + "\n\n" + template("free_run")

    return load_kernel("free_run", [system.digest], build)
