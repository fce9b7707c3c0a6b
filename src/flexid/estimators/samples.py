"""Measured samples as the estimators take them: plain arrays for any parametric system."""

from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.recording import Recording
from flexid.recording.velocities import velocity


@dataclass(frozen=True, eq=False)
class Samples:
    """One contiguous, uniformly sampled recording of motion of a system with any number of rows.

    Parameters
    ----------
    positions : array, shape (n, n_rows)
        Coordinates of the rows, in the system's order.
    velocities : array, shape (n, n_rows), or None
        Their velocities, where known.
    inputs : array, shape (n, n_inputs)
        Inputs.
    sample_time : float
        Time between samples in s.
    start_time : float, optional
        Time of the first sample in s.
    """

    positions: FloatArray
    velocities: FloatArray | None
    inputs: FloatArray
    sample_time: float
    start_time: float = 0.0

    def __len__(self) -> int:
        return int(self.positions.shape[0])

    @property
    def time(self) -> FloatArray:
        """Time of every sample, shape (n,), in s."""
        return self.start_time + self.sample_time * np.arange(len(self), dtype=np.float64)

    def window(self, first: int, last: int) -> "Samples":
        """The samples from one to another, which does not belong to them.

        Parameters
        ----------
        first, last : int
            Places of the two.
        """
        part = slice(first, last)
        return Samples(
            self.positions[part],
            None if self.velocities is None else self.velocities[part],
            self.inputs[part],
            self.sample_time,
            self.start_time + first * self.sample_time,
        )


def samples_of_recording(recording: Recording) -> Samples:
    """Arrays of a recording for the rows link and motor of the flexible joint."""
    link, motor = recording.link_velocity, recording.motor_velocity
    return Samples(
        np.column_stack((recording.needed_link_position, recording.motor_position)),
        None if link is None or motor is None else np.column_stack((link, motor)),
        recording.needed_input[:, None].astype(np.float64),
        recording.sample_time,
        recording.start_time,
    )


def rigid_samples(recording: Recording) -> Samples:
    """Arrays of a recording for the one row of the rigid joint: those of the motor's encoder."""
    velocity = recording.motor_velocity
    return Samples(
        recording.motor_position[:, None],
        None if velocity is None else velocity[:, None],
        recording.needed_input[:, None].astype(np.float64),
        recording.sample_time,
        recording.start_time,
    )


def link_samples(recording: Recording) -> Samples:
    """Arrays of a recording for the link's row alone, whose inputs are the motor's motion."""
    link, motor = recording.link_velocity, recording.motor_velocity
    motor = velocity(recording.motor_position, recording.sample_time) if motor is None else motor
    return Samples(
        recording.needed_link_position[:, None],
        None if link is None else link[:, None],
        np.column_stack((recording.motor_position, motor)),
        recording.sample_time,
        recording.start_time,
    )
