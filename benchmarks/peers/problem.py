"""What every tool is given, and what it gives back."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from flexid.arrays import FloatArray

COEFFICIENTS = ("theta1", "theta2", "alpha1", "alpha2", "beta1")
"""x2' = -theta1 sin x1 - theta2 (x1 - x3); x4' = alpha1 (x1 - x3) - alpha2 x4 + beta1 u."""


@dataclass(frozen=True)
class Log:
    """A log as flexid reads it from a file, and what the other tools' users know besides.

    Parameters
    ----------
    path : Path
        The CSV file. flexid reads this, and is given nothing of what follows.
    time : (n,) array
        In s, evenly spaced.
    positions : (n, 2) array
        Link and motor, in rad.
    velocities : (n, 2) array or None
        The same in rad/s; None where there are only encoders.
    torque : (n,) array
        In N m.
    held : bool
        Whether the torque is constant until the next sample; else it runs linearly to it.
    position_noise, velocity_noise : float
        True standard deviations, as a data sheet might state them.
    guess : mapping of str to float
        For tools that need starting values: all coefficients, at half their true value.
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
        """In s."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    @property
    def mean_torque(self) -> FloatArray:
        """Mean over each interval between samples, shape (n - 1,)."""
        return self.torque[:-1] if self.held else 0.5 * (self.torque[:-1] + self.torque[1:])


@dataclass(frozen=True)
class Answer:
    """What a tool says.

    Parameters
    ----------
    values : mapping of str to float
        The five coefficients.
    intervals : mapping of str to (float, float), or None
        Nominal 95 % intervals; None where the tool has none.
    """

    values: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]] | None = None


def normal_intervals(
    values: Mapping[str, float], deviations: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Value -/+ 1.96 standard deviations."""
    return {
        name: (value - 1.96 * deviations[name], value + 1.96 * deviations[name])
        for name, value in values.items()
    }
