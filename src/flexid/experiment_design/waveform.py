"""Sums of tones that begin and end at rest.

    s(t) = w(t) Σ_k [a_k cos(ω_k t) + b_k sin(ω_k t)],    ω_k = 2π n_k / T,

with whole numbers n_k spread evenly on a logarithmic scale, and a window w that rises from 0 to 1
and falls back along half a cosine, so that the signal and its rate are zero at both ends.
"""

from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Waveform:
    """Windowed tones at the samples of an experiment."""

    angular_frequencies: FloatArray  # (m,): rad/s
    time: FloatArray  # (n,): s
    columns: FloatArray  # (n, 2 m): windowed cosines, then windowed sines
    rate_columns: FloatArray  # (n, 2 m): their derivatives

    def signal(self, weights: FloatArray) -> FloatArray:
        """The signal, shape (n,), for weights a_1 … a_m, b_1 … b_m."""
        return self.columns @ weights

    def rate(self, weights: FloatArray) -> FloatArray:
        """Its derivative, shape (n,)."""
        return self.rate_columns @ weights


def waveform(
    duration: float, sample_time: float, ramp: float, highest_frequency: float, harmonics: int
) -> Waveform:
    """Windowed tones for an experiment."""
    base = 2.0 * np.pi / duration
    most = max(harmonics, int(highest_frequency / base))
    numbers = np.unique(np.rint(np.geomspace(1.0, most, harmonics)).astype(int))
    spare = [n for n in range(1, most + 1) if n not in numbers][: harmonics - len(numbers)]
    rates = base * np.sort(np.concatenate((numbers, spare))).astype(np.float64)
    time = sample_time * np.arange(round(duration / sample_time) + 1, dtype=np.float64)
    window, slope = _window(time, duration, ramp)
    phase = np.outer(time, rates)
    cosines, sines = np.cos(phase), np.sin(phase)
    tones = np.hstack((cosines, sines))
    tone_rates = np.hstack((-rates * sines, rates * cosines))
    return Waveform(
        rates,
        time,
        window[:, None] * tones,
        slope[:, None] * tones + window[:, None] * tone_rates,
    )


def _window(time: FloatArray, duration: float, ramp: float) -> tuple[FloatArray, FloatArray]:
    """Window and its derivative."""
    inner = np.clip(np.minimum(time, duration - time) / ramp, 0.0, 1.0)
    direction = np.where(inner < 1.0, np.where(time < duration / 2, 1.0, -1.0), 0.0)
    window = 0.5 - 0.5 * np.cos(np.pi * inner)
    slope = direction * 0.5 * np.pi / ramp * np.sin(np.pi * inner)
    return window, slope
