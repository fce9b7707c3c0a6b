"""Free run: the model alone, from an initial state, under a recorded input."""

from collections.abc import Mapping
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexid.errors import SimulationError
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.simulation.substeps import runge_kutta_substeps


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
    substeps = runge_kutta_substeps(kernel, x0, u[0], p, c, sample_time)
    written = kernel.free_run(x0, u, p, c, sample_time, held, substeps, out)
    if written < len(u):
        raise SimulationError(
            "the free run of the model diverges: its coefficients make it unstable",
            written * sample_time,
        )
    return out


def free_run_kernel(system: ParametricSystem) -> ModuleType:
    """Compiled module with ``right_hand_side`` and ``free_run`` of a system."""

    def build() -> str:
        from flexid.derivation.model_functions import model_functions

        return model_functions(system, "Free run")

    return load_kernel("free_run", [system.digest], build, ["free_run"])
