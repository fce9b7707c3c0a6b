"""Measured samples as the estimators take them: plain arrays for any parametric system."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexid.errors import SettingError
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Recording

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Samples:
    """One contiguous, uniformly sampled piece of motion of a system with any number of rows.

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


def samples_of_recording(recording: Recording) -> Samples:
    """Arrays of a recording for the rows link and motor of the flexible joint."""
    link, motor = recording.link_velocity, recording.motor_velocity
    return Samples(
        np.column_stack((recording.link_position, recording.motor_position)),
        None if link is None or motor is None else np.column_stack((link, motor)),
        recording.input[:, None].astype(np.float64),
        recording.sample_time,
        recording.start_time,
    )


def constant_values(
    system: ParametricSystem, constants: Mapping[str, float] | None = None
) -> FloatArray:
    """Values of the system's constants in order, replaced where `constants` says so.

    Raises
    ------
    SettingError
        If `constants` names something that the system does not have.
    """
    values = dict(system.constants)
    for name, value in (constants or {}).items():
        if name not in values:
            known = ", ".join(values) or "none"
            raise SettingError(
                "constants", f"{name!r} is no constant of this model; it has {known}"
            )
        values[name] = float(value)
    return np.array(list(values.values()), dtype=np.float64)
