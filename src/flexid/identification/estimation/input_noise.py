"""Noise of the input's sensor in fits with disturbances.

Noise of the logged input did not move the drive. The motor's balance then takes its gain for too
small, mainly at frequencies where the noise is as large as the input (errors in variables). If the
input is replaced by its expected value given the log, the difference is uncorrelated with it and
acts as a disturbance, without bias (regression calibration: Carroll et al., Measurement Error in
Nonlinear Models, 2006, ch. 4). If all of the logged input moved the drive, as a commanded one does,
the replaced one fits worse. So the likelihood decides.
"""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.samples import Samples
from flexid.identification.estimation.band import JointInBand
from flexid.identification.full_model.model import Data
from flexid.identification.structure.gap import CHANCE
from flexid.recording.velocities import position_noise

_LENGTH = 256  # samples over which a spectrum is computed
# Standard deviation of the error that remains, over the change of the values without the noise. In
# six of seven logs of rigs with noise of 1 to 2 % of the torque, the values without it differed by
# 0.1 to 0.5 of the change from those of a log that never had it; in one the change was an error.
_LEFT = 0.25
# Deviation over the change if the logged input is kept: uniform between none and all of the noise.
# A part of it may be the sensor's even if not all is. A robot's motor inertia was then 40 % wrong.
_AS_LOGGED = 1.0 / np.sqrt(3.0)


@dataclass(frozen=True)
class InputChoice:
    """Choice between the logged input and its expected value without its sensor's noise."""

    without_noise: bool = False
    left: float = 0.0  # standard deviation of a value, over its change by the other input

    def of(self, data: Data) -> Data:
        """Return a log with the chosen input."""
        return without_input_noise(data) if self.without_noise else data

    def removed_from(self, data: Data) -> float:
        """Return the standard deviation of the noise removed from a log's input."""
        return max(map(_noise, data.samples)) if self.without_noise else 0.0

    def other_of(self, data: Data) -> Data:
        """Return a log with the input that was not chosen."""
        return data if self.without_noise else without_input_noise(data)


def likelier_input(logged: JointInBand) -> tuple[JointInBand, InputChoice]:
    """Return the fit with the likelier input, from the fit with the logged one, and the choice."""
    fitted, data = logged.fitted, logged.band.data
    if fitted.structure.joint.kind == "link" or not any(map(_noise, data.samples)):
        return logged, InputChoice()
    quiet = replace(logged.band, data=without_input_noise(data))
    with suppress(ConvergenceError):
        found = quiet.fit(fitted.structure, fitted.by_name, logged.sizes)
        if found.cost < logged.cost - CHANCE and found.fitted.has_partners:
            return found, InputChoice(without_noise=True, left=_LEFT)
    return logged, InputChoice(left=_AS_LOGGED)


def without_input_noise(data: Data) -> Data:
    """Return a log with the expected value of its input, given white noise of its sensor."""
    samples = [
        replace(recording, inputs=_expected(recording.inputs[:, 0], _noise(recording) ** 2))
        for recording in data.samples
    ]
    return replace(data, samples=tuple(samples))


def _noise(recording: Samples) -> float:
    """Return the standard deviation of the input's noise."""
    return position_noise(recording.inputs[:, 0])


def _expected(logged: FloatArray, variance: float) -> FloatArray:
    """Return the expected value of an input, shape (n, 1), by a Wiener filter without delay."""
    from scipy.signal import welch  # imported late: it takes a third of a second

    frequencies, density = welch(logged, nperseg=min(_LENGTH, len(logged)))
    noise = 2.0 * variance  # density of white noise, for frequencies of 0 to 1/2 per sample
    shares = np.clip(1.0 - noise / np.maximum(density, np.finfo(float).tiny), 0.0, 1.0)
    shares[0] = 1.0  # the mean, which the spectrum omits
    mirrored = np.concatenate((logged, logged[::-1]))
    own = np.interp(np.fft.rfftfreq(len(mirrored)), frequencies, shares)
    filtered = np.fft.irfft(own * np.fft.rfft(mirrored), len(mirrored))
    return np.ascontiguousarray(filtered[: len(logged), None])
