"""Play a command on a believed drive: how far it moves, and what its positions would determine."""

from dataclasses import dataclass

import numpy as np

from flexid.analysis.information import Information, segmented_information
from flexid.arrays import FloatArray
from flexid.estimators.samples import Samples
from flexid.estimators.segments import divide
from flexid.experiment_design.drive import Case, Limits
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
