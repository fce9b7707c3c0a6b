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
    """What the drive is given, sample by sample.

    Parameters
    ----------
    torque : (n,) ndarray
        Torque in the input's unit, held over each interval.
    reference : (n, 2) ndarray
        Position and velocity that the motor shall follow, in rad and rad/s.
    gains : (2,) ndarray
        Proportional and derivative gain of the drive's position loop, in the input's unit per rad
        and per rad/s; both zero where the torque alone is played.
    """

    torque: FloatArray
    reference: FloatArray
    gains: FloatArray

    def scaled(self, factor: float) -> "Command":
        """The same motion smaller or larger about its first position."""
        first = self.reference[0]
        return Command(factor * self.torque, first + factor * (self.reference - first), self.gains)


def play(
    system: ParametricSystem,
    coefficients: Mapping[str, float],
    start: FloatArray,
    command: Command,
    sample_time: float,
    tracked: int = 2,
) -> tuple[FloatArray, FloatArray]:
    """Simulate a system while its first input plays a command, without any limit.

    Parameters
    ----------
    system : ParametricSystem
        The model; its constants have the values declared in it.
    coefficients : mapping of str to float
        A value for each of its coefficients.
    start : (n_states,) ndarray
        State at the first sample.
    command : Command
        Torque or reference.
    sample_time : float
        Seconds between samples.
    tracked : int, optional
        Place of the position that follows the reference: the motor's by default.

    Returns
    -------
    states : (n, n_states) ndarray
    inputs : (n,) ndarray
        What the first input was, held from each sample to the next.

    Raises
    ------
    SimulationError
        If the motion grows beyond all bounds, or the model is far too fast for the sample time.
    """
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
