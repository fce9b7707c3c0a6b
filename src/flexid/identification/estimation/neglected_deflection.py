"""Doubt about a drive that was taken as rigid though its joint bends.

Below its resonance the link of a flexible joint accelerates r times as much as the motor, with r
above 1. A rigid joint moves as the mean of both (`preparation.recordings`). Then its inertia is
wrong by the share (J2 - J1) / 2 (J1 + J2) of r - 1. The log shows r; the share is unknown, between
-1/2 and 1/2.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.flexible_joint import RIGID_UNITS
from flexid.recording.recording import Recording

_BAND = 0.99  # share of the input's power in the band; above it are noise and steps of encoders
_SPREAD = 0.5 / np.sqrt(3.0)  # root mean square of a uniform share between -1/2 and 1/2


def with_neglected_deflection(estimate: Estimate, recordings: Iterable[Recording]) -> Estimate:
    """Return a rigid joint's estimate with the doubt about its inertia.

    All coefficients are divided by the inertia, so they change alike.
    """
    share = _SPREAD * excess_of_link(recordings)
    base = [name.partition("[")[0] in RIGID_UNITS for name in estimate.names]
    moved = share * np.where(base, estimate.values, 0.0)
    return estimate.widened(np.outer(moved, moved))


def excess_of_link(recordings: Iterable[Recording]) -> float:
    """Return how much more the link accelerates than the motor, relative; 0 if not known.

    Both are correlated with the input, which has no noise of the encoders.
    """
    more, motor = 0.0, 0.0
    for recording in recordings:
        if recording.link_position is None or recording.clamped:
            continue
        frequency = np.fft.rfftfreq(len(recording), recording.sample_time)
        drive, moves, bends = (
            _spectrum(channel)
            for channel in (recording.needed_input, recording.motor_position, recording.deflection)
        )
        power = np.cumsum(np.abs(drive) ** 2)
        band = slice(1 + int(np.searchsorted(power, _BAND * power[-1])))
        weight = (np.conj(drive) * frequency**2)[band]
        more += float(np.sum(weight * bends[band]).real)
        motor += float(np.sum(weight * moves[band]).real)
    return abs(more / motor) if motor else 0.0


def _spectrum(values: FloatArray) -> NDArray[np.complex128]:
    """Return the spectrum of a channel without its trend."""
    line = np.polyval(np.polyfit(np.arange(len(values)), values, 1), np.arange(len(values)))
    return np.fft.rfft((values - line) * np.hanning(len(values)))
