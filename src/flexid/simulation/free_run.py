"""Free run: the model alone, from an initial state, under a recorded input."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexid.errors import SimulationError
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.simulation.substeps import HELD_INPUT, runge_kutta_substeps


def free_run(
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    initial_state: ArrayLike,  # (n_states,)
    inputs: ArrayLike,  # (n,) or (n, n_inputs)
    sample_time: float,  # s
    hold: Hold = "linear",  # or "zero"
) -> NDArray[np.float64]:
    """States (n, n_states) of the model alone, from an initial state under a recorded input."""
    u = np.ascontiguousarray(inputs, dtype=float).reshape(len(np.asarray(inputs)), -1)
    x0 = np.asarray(initial_state, dtype=float)
    return FreeRunner.near(system, coefficients, x0, u[0], sample_time, hold).run(x0, u)


@dataclass(frozen=True, eq=False)
class FreeRunner:
    """Free runs of one model from several states that lie close to each other."""

    kernel: ModuleType  # of the model
    coefficients: NDArray[np.float64]  # of the model, in its order
    constants: NDArray[np.float64]  # of the model, in its order
    sample_time: float  # in s
    held: bool  # whether the input is constant until the next sample
    substeps: int  # of the integrator per sample

    @classmethod
    def near(
        cls,
        system: ParametricSystem,
        coefficients: Mapping[str, float],
        state: NDArray[np.float64],
        first_input: NDArray[np.float64],
        sample_time: float,
        hold: Hold,
    ) -> "FreeRunner":
        """Prepare for runs from about a state; parameters and errors are those of `free_run`."""
        kernel = free_run_kernel(system)
        p = np.array([coefficients[name] for name in system.coefficients])
        c = np.array(list(system.constants.values()), dtype=float)
        substeps = runge_kutta_substeps(kernel, state, first_input, p, c, sample_time)
        return cls(kernel, p, c, sample_time, hold == "zero", substeps)

    def run(
        self, initial_state: NDArray[np.float64], inputs: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """States, shape (n, n_states), at the samples of the inputs, shape (n, n_inputs)."""
        out = np.empty((len(inputs), len(initial_state)))
        written = self.kernel.free_run(
            initial_state,
            inputs,
            self.coefficients,
            self.constants,
            self.sample_time,
            int(self.held),
            self.substeps,
            out,
        )
        if written < len(inputs):
            raise SimulationError(
                "the free run of the model diverges: its coefficients make it unstable",
                written * self.sample_time,
            )
        return out


def free_run_kernel(system: ParametricSystem) -> ModuleType:
    """Compiled module with ``right_hand_side`` and ``free_run`` of a system."""

    def build() -> str:
        from flexid.derivation.linearisation import moving_model

        return moving_model(system, "Free run")

    return load_kernel("free_run", [system.digest], build, [*HELD_INPUT, "free_run"])
