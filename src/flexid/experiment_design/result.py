"""What a design returns."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.experiment_design.assessment import DETERMINED_DEVIATION
from flexid.experiment_design.drive import Drive
from flexid.experiment_design.rehearse import Rehearsed
from flexid.simulation.free_run import Command


@dataclass(frozen=True)
class Prediction:
    """What an input would determine of the drive as it is believed to be."""

    name: str  # of the input
    # predicted standard deviation of each coefficient over its value
    deviations: Mapping[str, float]
    e_deviation: float  # criterion E as a relative standard deviation
    d_deviation: float  # criterion D likewise
    peaks: Mapping[str, float]  # torque in N m, velocity in rad/s, position and deflection in rad
    torque_rms: float  # N m
    within_limits: bool  # of the drive as believed

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
    """An experiment, its predictions and its checks."""

    drive: Drive
    angular_frequencies: FloatArray  # (m,): rad/s
    weights: FloatArray  # (2 m,): of cosines and sines; N m for a torque, rad for a trajectory
    time: FloatArray  # (n,): s
    command: Command
    run: Rehearsed  # of the drive as believed
    prediction: Prediction
    references: tuple[Prediction, ...]  # other inputs of the same peak torque
    # the same, as large as all drives bear within the limits
    kept_references: tuple[Prediction, ...]
    largest_use: Mapping[str, Extreme]  # of each limit, over all wrong drives
    largest_deviations: Mapping[str, Extreme]  # of each coefficient, over all wrong drives
    scale: float  # factor on what the search found, so that all drives keep to the limits
    seed: int  # of the search and of the wrong drives
    provenance: Mapping[str, object]  # version, inputs with their hashes, settings

    @property
    def amplitudes(self) -> FloatArray:
        """Amplitude of each tone, shape (m,), in the weights' unit."""
        cosines, sines = np.split(self.weights, 2)
        return np.hypot(cosines, sines)

    @property
    def supported(self) -> bool:
        """Whether every coefficient would be known to 10 % or better."""
        return self.prediction.worst <= DETERMINED_DEVIATION
