"""A model alone: under a recorded input, or as its drive moves it."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike

from flexid.arrays import FloatArray
from flexid.errors import SimulationError
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.simulation.sampled import runge_kutta_substeps


@dataclass(frozen=True, eq=False)
class Command:
    """What the drive is given, sample by sample."""

    torque: FloatArray  # (n,), torque in the input's unit, held over each interval
    # (n, 2), position and velocity that the motor shall follow, in rad and rad/s
    reference: FloatArray
    # (2,), proportional and derivative gain of the drive's position loop, in the input's unit per
    # rad and per rad/s; both zero where the torque alone is played
    gains: FloatArray

    def scaled(self, factor: float) -> "Command":
        """The same motion smaller or larger about its first position."""
        first = self.reference[0]
        return Command(factor * self.torque, first + factor * (self.reference - first), self.gains)


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
    states, written = _run(
        system, coefficients, initial_state, u, u[0], sample_time, hold == "zero", _NO_LOOP
    )
    if written < len(states):
        raise SimulationError(
            "the free run of the model diverges: its coefficients make it unstable",
            written * sample_time,
        )
    return states


def play(
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    start: FloatArray,  # (n_states,), state at the first sample
    command: Command,
    sample_time: float,
) -> tuple[FloatArray, FloatArray]:
    """States (n, n_states) and first inputs (n,) of a system that plays a command."""
    u = np.zeros((len(command.torque), len(system.inputs)))
    still = u[0].copy()
    u[:, 0] = command.torque
    loop = (2, command.reference, command.gains)  # the motor follows
    states, written = _run(system, coefficients, start, u, still, sample_time, True, loop)
    if written < len(states):
        raise SimulationError("the motion grows beyond all bounds", written * sample_time)
    return states, u[:, 0].copy()


_NO_LOOP = (0, np.empty((0, 2)), np.zeros(2))


def _run(
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    start: ArrayLike,
    inputs: FloatArray,  # (n, n_inputs), to which a drive's position loop adds its own
    first_input: FloatArray,  # (n_inputs,), about which the steps are chosen
    sample_time: float,
    held: bool,
    loop: tuple[int, FloatArray, FloatArray],
) -> tuple[FloatArray, int]:
    """States (n, n_states), and how many of them were reached before the motion diverged."""
    x = np.asarray(start, dtype=float)
    p = np.array([coefficients[name] for name in system.coefficients])
    c = np.array(list(system.constants.values()), dtype=float)
    substeps = runge_kutta_substeps(system, x, first_input, p, c, sample_time)
    states = np.empty((len(inputs), len(x)))
    run = load_kernel("free_run", (), None, ["free_run"]).free_run
    address = _compiled_rates(system).right_hand_side.address
    return states, run(address, x, inputs, loop, p, c, sample_time, held, substeps, states)


def _compiled_rates(system: ParametricSystem) -> ModuleType:
    """What the run calls of a model."""

    def build() -> str:
        from flexid.derivation.model_functions import compiled_rates

        return compiled_rates(system)

    return load_kernel("rates", [system.digest], build)
