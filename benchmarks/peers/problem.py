"""Input and output of every compared tool."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flexid.arrays import FloatArray

COEFFICIENTS = ("theta1", "theta2", "alpha1", "alpha2", "beta1")
"""x2' = -theta1 sin x1 - theta2 (x1 - x3); x4' = alpha1 (x1 - x3) - alpha2 x4 + beta1 u."""


@dataclass(frozen=True)
class Log:
    """A log, and information that only the users of other tools have.

    Parameters
    ----------
    path : Path
        CSV file. flexid reads only this file.
    time : (n,) array
        In s, evenly spaced.
    positions : (n, 2) array
        Link and motor, in rad.
    velocities : (n, 2) array or None
        Velocities of link and motor in rad/s; None if there are only encoders.
    torque : (n,) array
        In N m.
    held : bool
        Whether the torque is constant until the next sample; otherwise it is linear.
    position_noise, velocity_noise : float
        True standard deviations, as from a data sheet.
    guess : mapping of str to float
        Starting values for tools that need them: half the true coefficients.
    """

    path: Path
    time: FloatArray
    positions: FloatArray
    velocities: FloatArray | None
    torque: FloatArray
    held: bool
    position_noise: float
    velocity_noise: float
    guess: Mapping[str, float]

    @property
    def sample_time(self) -> float:
        """Sample time in s."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def mean_torque(self) -> FloatArray:
        """Mean torque over each interval between samples, shape (n - 1,)."""
        return self.torque[:-1] if self.held else 0.5 * (self.torque[:-1] + self.torque[1:])


@dataclass(frozen=True)
class Answer:
    """Result of a tool.

    Parameters
    ----------
    values : mapping of str to float
        The five coefficients.
    intervals : mapping of str to (float, float), or None
        Nominal 95 % intervals; None if the tool gives none.
    """

    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]] | None = None


def normal_intervals(
    values: Mapping[str, float], deviations: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Return intervals of the value -/+ 1.96 standard deviations."""
    return {
        name: (value - 1.96 * deviations[name], value + 1.96 * deviations[name])
        for name, value in values.items()
    }
