"""What a design returns."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.experiment_design.assessment import DETERMINED_DEVIATION
from flexid.experiment_design.drive import Drive
from flexid.experiment_design.rehearse import Rehearsed
from flexid.simulation.played_run import Command


@dataclass(frozen=True)
class Prediction:
    """What an input would determine of the drive as it is believed to be.

    Parameters
    ----------
    name : str
        Which input.
    deviations : mapping of str to float
        Predicted standard deviation of each coefficient over its value.
    e_deviation, d_deviation : float
        The criteria E and D as relative standard deviations.
    peaks : mapping of str to float
        Largest torque in N m, velocity in rad/s, position and deflection in rad.
    torque_rms : float
        Root mean square of the torque in N m.
    within_limits : bool
        Whether the drive, as believed, keeps to the limits.
    """

    name: str
    deviations: Mapping[str, float]
    e_deviation: float
    d_deviation: float
    peaks: Mapping[str, float]
    torque_rms: float
    within_limits: bool

    @property
    def worst(self) -> float:
        """Largest of the deviations."""
        return max(self.deviations.values())


@dataclass(frozen=True)
class Extreme:
    """The largest value over wrong drives, and which one it was."""

    value: float
    case: str


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment, its predictions and its checks.

    Parameters
    ----------
    drive : Drive
        What was believed and wanted.
    angular_frequencies : array, shape (m,)
        Tones in rad/s.
    weights : array, shape (2 m,)
        Weights of their cosines and sines: N m for a torque, rad for a trajectory.
    time : array, shape (n,)
        Samples in s.
    command : Command
        What the drive is given.
    run : Rehearsed
        What the drive, as believed, does then.
    prediction : Prediction
        What that determines.
    references : tuple of Prediction
        What other inputs of the same peak torque would determine.
    kept_references : tuple of Prediction
        What they would determine if they were as large as all drives can bear within the limits.
    largest_use : mapping of str to Extreme
        Largest use of each limit over all drives that are wrong by 30 %.
    largest_deviations : mapping of str to Extreme
        Largest deviation of each coefficient over them.
    scale : float
        Factor on what the search found, so that all of them keep to the limits.
    seed : int
        Of the search and of the wrong drives.
    provenance : mapping
        Version, inputs with their hashes, settings.
    """

    drive: Drive
    angular_frequencies: FloatArray
    weights: FloatArray
    time: FloatArray
    command: Command
    run: Rehearsed
    prediction: Prediction
    references: tuple[Prediction, ...]
    kept_references: tuple[Prediction, ...]
    largest_use: Mapping[str, Extreme]
    largest_deviations: Mapping[str, Extreme]
    scale: float
    seed: int
    provenance: Mapping[str, object]

    @property
    def amplitudes(self) -> FloatArray:
        """Amplitude of each tone, shape (m,), in the weights' unit."""
        cosines, sines = np.split(self.weights, 2)
        return np.hypot(cosines, sines)

    @property
    def supported(self) -> bool:
        """Whether every coefficient would be known to 10 % or better."""
        return self.prediction.worst <= DETERMINED_DEVIATION
