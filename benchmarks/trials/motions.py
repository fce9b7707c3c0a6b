"""What is played: torques and references as sums of sines, one of which may sweep."""

from dataclasses import dataclass

import numpy as np

from benchmarks.trials.arrays import FloatArray


@dataclass(frozen=True)
class Motion:
    """A sum of sines, ``sum a sin(f t + s t^2 / 2 + phase)``.

    Parameters
    ----------
    amplitudes, frequencies, sweeps, phases : (k,) ndarray
        Frequencies in rad/s, sweeps in rad/s².
    kind : str
        What it is, in a word.
    """

    amplitudes: FloatArray
    frequencies: FloatArray
    sweeps: FloatArray
    phases: FloatArray
    kind: str

    def at(self, time: FloatArray) -> FloatArray:
        """Values at some times, shape (n,)."""
        total = np.zeros(len(time))
        for a, f, s, phase in self._parts():
            total += a * np.sin((f + 0.5 * s * time) * time + phase)
        return total

    def rate_at(self, time: FloatArray) -> FloatArray:
        """Derivatives at some times, shape (n,)."""
        total = np.zeros(len(time))
        for a, f, s, phase in self._parts():
            total += a * (f + s * time) * np.cos((f + 0.5 * s * time) * time + phase)
        return total

    def _parts(self) -> list[tuple[float, float, float, float]]:
        columns = (self.amplitudes, self.frequencies, self.sweeps, self.phases)
        return [
            (float(a), float(f), float(s), float(p)) for a, f, s, p in zip(*columns, strict=True)
        ]


def draw_torque(rng: np.random.Generator, resonance: float, duration: float) -> Motion:
    """Draw a torque of about unit size: two to four sines, a sweep, or filtered noise."""
    kind = str(rng.choice(["sines", "sines", "sines", "chirp", "noise"]))
    if kind == "sines":
        count = int(rng.integers(2, 5))
        low, high = np.array([0.08, 0.5]), np.array([0.35, 1.3])
        shares = np.exp(rng.uniform(np.log(low), np.log(high)))
        rest = np.exp(rng.uniform(np.log(0.08), np.log(1.3), count - 2))
        frequencies = resonance * np.append(shares, rest)
        amplitudes = rng.uniform(0.3, 1.0, count)
        sweeps = np.zeros(count)
    elif kind == "chirp":  # with one slow sine, which keeps the link moving
        first, last, slow = resonance * rng.uniform([0.1, 0.7, 0.08], [0.3, 1.5, 0.3])
        frequencies, sweeps = np.array([first, slow]), np.array([(last - first) / duration, 0.0])
        amplitudes = np.array([1.0, rng.uniform(0.2, 1.0)])
    else:
        frequencies = np.sort(resonance * rng.uniform(0.03, 1.3, 40))
        corner = resonance * rng.uniform(0.2, 0.8)
        amplitudes = rng.rayleigh(0.3, 40) / np.sqrt(1.0 + (frequencies / corner) ** 2)
        sweeps = np.zeros(40)
    phases = rng.uniform(0.0, 2.0 * np.pi, len(frequencies))
    return Motion(amplitudes, frequencies, sweeps, phases, kind)


def draw_reference(rng: np.random.Generator, resonance: float) -> Motion:
    """Draw a smooth reference of about unit size for a position controller."""
    count = int(rng.integers(3, 7))
    fastest = min(12.0, 0.6 * resonance)
    frequencies = np.exp(rng.uniform(np.log(0.4), np.log(fastest), count))
    amplitudes = rng.uniform(0.3, 1.0, count) / np.sqrt(1.0 + (frequencies / 3.0) ** 2)
    phases = rng.uniform(0.0, 2.0 * np.pi, count)
    return Motion(amplitudes, frequencies, np.zeros(count), phases, "tracking")
