"""What a joint does while its drive plays a torque, or follows a reference with its motor."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SimulationError
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.substeps import HELD_INPUT, runge_kutta_substeps


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


def play(
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    start: FloatArray,  # (n_states,), state at the first sample
    command: Command,
    sample_time: float,
    tracked: int = 2,
) -> tuple[FloatArray, FloatArray]:
    """States (n, n_states) and first inputs (n,) of a system that plays a command."""
    kernel = played_kernel(system)
    p = np.array([coefficients[name] for name in system.coefficients])
    c = np.array(list(system.constants.values()), dtype=np.float64)
    still = np.zeros(len(system.inputs))
    count = len(command.torque)
    states, inputs = np.empty((count, len(system.states))), np.empty(count)
    substeps = runge_kutta_substeps(kernel, start, still, p, c, sample_time)
    written = kernel.played_run(
        np.asarray(start, dtype=np.float64),
        (command.torque, command.reference, command.gains),
        tracked,
        p,
        c,
        sample_time,
        substeps,
        states,
        inputs,
    )
    if written < count:
        raise SimulationError("the motion grows beyond all bounds", written * sample_time)
    return states, inputs


def played_kernel(system: ParametricSystem) -> ModuleType:
    """Compiled module with ``right_hand_side`` and ``played_run`` of a system."""

    def build() -> str:
        from flexid.derivation.linearisation import moving_model

        return moving_model(system, "Played run")

    return load_kernel("played_run", [system.digest], build, [*HELD_INPUT, "played_run"])
