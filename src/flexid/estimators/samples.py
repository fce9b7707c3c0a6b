"""Measured samples as the estimators take them: plain arrays for any parametric system."""

from dataclasses import dataclass
from typing import Literal

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


def samples_of_recording(
    recording: Recording, kind: Literal["flexible", "rigid", "link"] = "flexible"
) -> Samples:
    """Arrays of a recording for the rows of a joint: link and motor, the motor's or the link's.

    The link's row alone has the motor's motion as its inputs.
    """
    link, motor = recording.link_velocity, recording.motor_velocity
    positions, velocities = [recording.motor_position], [motor]
    if kind == "flexible":
        positions, velocities = [recording.needed_link_position, *positions], [link, motor]
    if kind == "link":
        if motor is None:
            motor = velocity(recording.motor_position, recording.sample_time)
        inputs = [recording.motor_position, motor]
        positions, velocities = [recording.needed_link_position], [link]
    else:
        inputs = [recording.needed_input]
    known = [v for v in velocities if v is not None]
    return Samples(
        np.column_stack(positions),
        np.column_stack(known) if len(known) == len(velocities) else None,
        np.column_stack(inputs).astype(np.float64),
        recording.sample_time,
        recording.start_time,
    )
