"""A trial's log for tools that cannot find delays and terms, which are given from the truth."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline, PPoly

from benchmarks.trials.arrays import FloatArray
from benchmarks.trials.generate import Trial
from benchmarks.trials.plain_least_squares import plain_least_squares

Intervals = Mapping[str, tuple[float, float]]


@dataclass(frozen=True)
class Answer:
    """Result of a tool.

    Parameters
    ----------
    values : mapping of str to float
        Physical parameters by flexid's names.
    intervals : mapping of str to (float, float), or None
        Nominal 95 % intervals; None if the tool gives none.
    """

    values: Mapping[str, float]
    intervals: Intervals | None = None


@dataclass(frozen=True, eq=False)
class Given:
    """A log with all channels on one clock, and the information given to its user.

    Parameters
    ----------
    time : array, shape (n,)
        In s, evenly spaced.
    positions : array, shape (n, 2)
        Link and motor in rad, corrected for their delays.
    terms : tuple of str
        Terms that act, by flexid's names.
    start : mapping of str to float
        Starting values: physical parameters by filtered least squares with these terms.
    resonance : float
        Resonance in rad/s.
    """

    time: FloatArray
    positions: FloatArray
    terms: tuple[str, ...]
    start: Mapping[str, float]
    resonance: float
    _impulse: PPoly

    def window(self, angle: float) -> int:
        """Return the odd number of samples in which the resonance's phase advances by an angle."""
        return 2 * round(0.5 * angle / self.resonance / self.sample_time) + 1

    @property
    def sample_time(self) -> float:
        """Sample time in s."""
        return float((self.time[-1] - self.time[0]) / (len(self.time) - 1))

    def mean_torque(self, edges: FloatArray) -> FloatArray:
        """Mean of the acting torque between consecutive times, in N m."""
        return np.diff(self._impulse(edges)) / np.diff(edges)


def given(trial: Trial) -> Given:
    """Return the data of a trial for users of other tools."""
    sample = float(trial.metadata["sample_time"])
    edge = int(np.ceil(0.01 / sample))  # samples at either end, left out because of delays
    time = trial.time[edge:-edge]
    link = CubicSpline(trial.time, trial.link_position)(time + trial.truth["link_delay"])
    acts = trial.time + trial.truth["input_delay"]
    if trial.hold == "zero":
        torque = PPoly(trial.torque[None, :-1], acts)
    else:
        torque = PPoly.construct_fast(CubicSpline(acts, trial.torque).c, acts)
    return Given(
        time,
        np.column_stack((link, trial.motor_position[edge:-edge])),
        trial.terms,
        plain_least_squares(trial),
        float(trial.metadata["resonance"]),
        torque.antiderivative(),
    )
