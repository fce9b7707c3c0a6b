"""What a command does on a believed drive, and what a design returns."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexid.analysis.information import Information, segmented_information
from flexid.arrays import FloatArray
from flexid.estimators.samples import Samples
from flexid.estimators.segments import divide
from flexid.experiment_design.drive import Case, Drive, Limits
from flexid.experiment_design.excitation_report import DETERMINED_DEVIATION
from flexid.simulation.free_run import Command, play

SEGMENT_DURATION = 1.0
"""Length in s of the segments that predictions hold for."""

CHANNELS = ("torque", "velocity", "position", "deflection")


@dataclass(frozen=True, eq=False)
class Rehearsed:
    """What a case did under a command."""

    states: FloatArray  # (n, 4): link position and velocity, motor position and velocity
    torque: FloatArray  # (n,): N m, held from each sample to the next
    sample_time: float  # s

    def _channels(self) -> dict[str, FloatArray]:
        x = self.states
        return {
            "torque": self.torque,
            "velocity": x[:, 1::2],
            "position": x[:, ::2],
            "deflection": x[:, 0] - x[:, 2],
        }

    def peaks(self) -> dict[str, float]:
        """Largest magnitude of each channel that has a limit."""
        return {name: float(np.abs(values).max()) for name, values in self._channels().items()}

    def shares(self, limits: Limits) -> dict[str, FloatArray]:
        """Each channel over its limit."""
        return {name: values / getattr(limits, name) for name, values in self._channels().items()}

    def use(self, limits: Limits) -> dict[str, float]:
        """Largest magnitude of each channel over its limit."""
        return {name: peak / getattr(limits, name) for name, peak in self.peaks().items()}

    def samples(self) -> Samples:
        """What the encoders would see, without noise."""
        return Samples(self.states[:, ::2], None, self.torque[:, None], self.sample_time)

    def information(self, case: Case, noise: float) -> Information:
        """What two encoders with white noise of a standard deviation in rad would determine."""
        segments = divide([self.samples()], SEGMENT_DURATION)
        states = self.states[segments.starts]
        return segmented_information(
            case.system, case.values, segments, states, np.full(2, noise), "zero"
        )


def rehearse(case: Case, command: Command, sample_time: float) -> Rehearsed:
    """Play a command from rest."""
    states, torque = play(case.system, case.coefficients, case.rest(), command, sample_time)
    return Rehearsed(states, torque, sample_time)


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
