"""References q_d(t) with exact derivatives of every order."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexid.errors import ModelError


@dataclass(frozen=True)
class Multisine:
    """q_d(t) = offset + Σ amplitude_i sin(angular_frequency_i t + phase_i).

    Examples
    --------
    >>> paper = Multisine([3.0], [5.0])
    >>> float(paper.evaluate(0.0, order=1))
    15.0
    """

    amplitudes: Sequence[float]  # in rad (or the unit of the coordinate that follows)
    angular_frequencies: Sequence[float]  # in rad/s, one per amplitude
    phases: Sequence[float] = ()  # in rad, one per amplitude; all zero if left out
    offset: float = 0.0  # in the unit of the amplitudes

    def __post_init__(self) -> None:
        for name in ("amplitudes", "angular_frequencies"):
            object.__setattr__(self, name, tuple(float(v) for v in getattr(self, name)))
        phases = self.phases or (0.0,) * len(self.amplitudes)
        object.__setattr__(self, "phases", tuple(float(v) for v in phases))
        if not len(self.amplitudes) == len(self.angular_frequencies) == len(self.phases):
            raise ModelError(
                "multisine",
                f"has {len(self.amplitudes)} amplitudes, {len(self.angular_frequencies)} angular "
                f"frequencies and {len(self.phases)} phases: give as many of each",
            )

    @property
    def expression(self) -> str:
        """q_d as a text expression in ``t`` and the parameters' names."""
        places = range(1, len(self.amplitudes) + 1)
        waves = (f"qd_amplitude{i}*sin(qd_frequency{i}*t + qd_phase{i})" for i in places)
        return " + ".join(["qd_offset", *waves])

    @property
    def parameters(self) -> dict[str, float]:
        """Names and values of the parameters."""
        values = {"qd_offset": float(self.offset)}
        waves = zip(self.amplitudes, self.angular_frequencies, self.phases, strict=True)
        for i, (amplitude, frequency, phase) in enumerate(waves, start=1):
            values[f"qd_amplitude{i}"] = amplitude
            values[f"qd_frequency{i}"] = frequency
            values[f"qd_phase{i}"] = phase
        return values

    @property
    def digest(self) -> str:
        """Hash of what a derivation depends on: the expression, not the parameters' values."""
        content = "\0".join((self.expression, *self.parameters))
        return hashlib.sha256(content.encode()).hexdigest()[:16]

    def evaluate(self, time: ArrayLike, order: int = 0) -> NDArray[np.float64]:
        """Derivative of the given order."""
        time = np.asarray(time, dtype=float)
        value = np.full(time.shape, self.offset if order == 0 else 0.0)
        waves = zip(self.amplitudes, self.angular_frequencies, self.phases, strict=True)
        for amplitude, frequency, phase in waves:
            # Every derivative turns a sine by a quarter period; sin and cos keep that exact.
            wave = np.cos if order % 2 else np.sin
            sign = -1.0 if order % 4 >= 2 else 1.0
            value += sign * amplitude * frequency**order * wave(frequency * time + phase)
        return value


def sinusoid(
    amplitude: float, angular_frequency: float, phase: float = 0.0, offset: float = 0.0
) -> Multisine:
    """One sine wave, the reference of Huang (2003), section 5; see `Multisine` for the units."""
    return Multisine((amplitude,), (angular_frequency,), (phase,), offset)


def constant(value: float) -> Multisine:
    """A reference that stands still."""
    return Multisine((), (), (), value)
