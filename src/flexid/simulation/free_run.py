"""A model alone, under a recorded input."""

from collections.abc import Mapping
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from flexid.arrays import FloatArray
from flexid.errors import SimulationError
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.simulation.sampled import runge_kutta_substeps


def free_run(
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    initial_state: ArrayLike,  # (n_states,)
    inputs: ArrayLike,  # (n,) or (n, n_inputs)
    sample_time: float,  # s
    hold: Hold = "linear",  # or "zero"
) -> FloatArray:
    """States (n, n_states) of the model alone, from an initial state under a recorded input."""
    u = np.ascontiguousarray(inputs, dtype=float).reshape(len(np.asarray(inputs)), -1)
    x = np.asarray(initial_state, dtype=float)
    p = np.array([coefficients[name] for name in system.coefficients])
    c = np.array(list(system.constants.values()), dtype=float)
    substeps = runge_kutta_substeps(system, x, u[0], p, c, sample_time)
    states = np.empty((len(u), len(x)))
    run = load_kernel("free_run", (), None, ["free_run"]).free_run
    address = _compiled_rates(system).right_hand_side.address
    written = run(address, x, u, p, c, sample_time, hold == "zero", substeps, states)
    if written < len(states):
        raise SimulationError(
            "the free run of the model diverges: its coefficients make it unstable",
            written * sample_time,
        )
    return states


def _compiled_rates(system: ParametricSystem) -> ModuleType:
    """What the run calls of a model."""

    def build() -> str:
        from flexid.derivation.model_functions import compiled_rates

        return compiled_rates(system)

    return load_kernel("rates", [system.digest], build)
