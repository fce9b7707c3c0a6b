"""Clock and encoders, their noise, and lost samples."""

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.trials.arrays import FloatArray
from benchmarks.trials.drafts import Draft

_RATES = (500, 625, 800, 1000, 1250, 1600, 2000)  # samples per second


@dataclass(frozen=True)
class Sensors:
    """Clock and encoders.

    Parameters
    ----------
    sample_time, duration, lead : float
        In s; the motion starts the lead before the log.
    count : float
        Step of the encoders in rad; zero without rounding.
    noise : float
        Standard deviation of the noise in rad, without rounding.
    zeros : tuple of float
        Zeros of the link's and motor's encoder within a step, in rad.
    """

    sample_time: float
    duration: float
    lead: float
    count: float
    noise: float
    zeros: tuple[float, float]

    @property
    def error(self) -> float:
        """Standard deviation of a reading's error in rad."""
        return self.count / np.sqrt(12.0) if self.count else self.noise

    @property
    def before(self) -> int:
        """Number of samples in the lead."""
        return round(self.lead / self.sample_time)

    @property
    def instants(self) -> FloatArray:
        """Nominal times with the lead, shape (n,); the log begins at zero."""
        count = round(self.duration / self.sample_time) + 1
        return self.sample_time * np.arange(-self.before, count)

    def read(self, angles: FloatArray, noise: FloatArray, side: int) -> FloatArray:
        """Return the readings of an encoder."""
        if not self.count:
            return angles + noise
        zero = self.zeros[side]
        return np.rint((angles + zero) / self.count) * self.count - zero


@dataclass(frozen=True)
class Noise:
    """Random errors, shape (n,): link and motor in rad, others over torque and sample time."""

    link: FloatArray
    motor: FloatArray
    torque: FloatArray
    jitter: FloatArray


def draw_sensors(rng: np.random.Generator, draft: Draft) -> Sensors:
    low, high = draft.bits
    count = 2.0 * np.pi / 2.0 ** int(rng.integers(low, high + 1))
    noise = float(np.exp(rng.uniform(*np.log(draft.noise))))
    rounded = rng.random() < 0.6
    zeros = rng.uniform(0.0, count, 2)
    return Sensors(
        sample_time=1.0 / float(rng.choice(_RATES)),
        duration=float(rng.uniform(*draft.durations)),
        lead=float(rng.uniform(0.05, 1.0)),
        count=count if rounded else 0.0,
        noise=0.0 if rounded else noise,
        zeros=(float(zeros[0]), float(zeros[1])),
    )


def faint(draft: Draft, sensors: Sensors, error: float) -> Sensors:
    """Return the clock with encoders of about the given error, within the usual range."""
    if not sensors.count:
        return replace(sensors, noise=float(np.clip(error, *draft.noise)))
    bits = round(np.log2(2.0 * np.pi / (error * np.sqrt(12.0))))
    count = 2.0 * np.pi / 2.0 ** float(np.clip(bits, *draft.bits))
    share = count / sensors.count
    return replace(sensors, count=count, zeros=(share * sensors.zeros[0], share * sensors.zeros[1]))


def draw_noise(rng: np.random.Generator, draft: Draft, sensors: Sensors) -> Noise:
    count = len(sensors.instants)
    link, motor, torque = rng.standard_normal((3, count))
    return Noise(
        sensors.noise * link,
        sensors.noise * motor,
        draft.torque_noise * torque,
        draft.jitter * rng.uniform(-1.0, 1.0, count),
    )


def with_losses(rng: np.random.Generator, lost: str, columns: FloatArray) -> FloatArray:
    """Remove a few rows, or replace them by the previous row."""
    if not lost:
        return columns
    places = rng.choice(np.arange(100, len(columns) - 100), int(rng.integers(2, 7)), replace=False)
    if lost == "stale":
        stale = columns.copy()
        stale[places, 1:] = columns[places - 1, 1:]
        return stale
    gone = [place + step for place in places for step in range(int(rng.integers(1, 5)))]
    return np.delete(columns, gone, axis=0)
