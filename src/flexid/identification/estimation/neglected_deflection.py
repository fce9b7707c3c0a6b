"""Doubts about a drive that was taken as rigid though its joint bends.

Below its resonance the link of a flexible joint accelerates r times as much as the motor, with r
above 1. With two encoders, a rigid joint moves as the mean of both (`preparation.recordings`). Then
its inertia is wrong by the share (J2 - J1) / 2 (J1 + J2) of r - 1. The log shows r; the share is
unknown, between -1/2 and 1/2.

With one encoder, r grows with the squared frequency ω² to first order. So does the inertia that the
motor drives, J + c ω². The log shows c if the motion has several frequencies. Then the inertia is
wrong by an unknown part of the change with c.

If the link is clamped, the spring pulls the motor back as gravity would, but more strongly.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import INPUT
from flexid.identification.vocabulary.evidence import Estimate
from flexid.models.flexible_joint import RIGID_UNITS
from flexid.recording.recording import Caution, Rank, Recording
from flexid.recording.slow_motion import scales_apart
from flexid.recording.velocities import with_velocities

_BAND = 0.99  # share of the power in the band; above it are noise and steps of encoders
_SPREAD = 0.5 / np.sqrt(3.0)  # root mean square of a uniform share between -1/2 and 1/2
_PART = 1.0 / np.sqrt(3.0)  # root mean square of a uniform part between 0 and 1
# Standard deviations of c: chance gives two in one log of 40, whose interval is then too wide. The
# inertia of 16 elastic drives with 2.3 or more was 3 to 80 % too large, and mostly 1 to 5 % wrong
# with c.
_BY_CHANCE = 2.0
_LOBE = 2  # half-width of a Hann window's main lobe, in which a trend would leak
_WINDOW = 1.5  # ratio of variances, since a Hann window correlates neighbouring frequencies
_TINY = np.finfo(float).tiny

# Torques against the motion per unit of a coefficient, but for the offset, which has no spectrum.
_REGRESSORS: Mapping[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    "gamma1": lambda position, _: np.sin(position),
    "gamma_cosine": lambda position, _: np.cos(position),
    "gamma_viscous": lambda _, velocity: velocity,
    "gamma_coulomb": lambda _, velocity: np.sign(velocity),
    "gamma_asymmetry": lambda _, velocity: np.abs(velocity),
}

_Spectrum = NDArray[np.complex128]


def with_bending(estimate: Estimate, recordings: Sequence[Recording]) -> Estimate:
    """Return a rigid joint's estimate with the doubt about its inertia, from two encoders.

    All coefficients are divided by the inertia, so they change alike. Encoders whose scales differ
    leave the same doubt.
    """
    apart = max(abs(scales_apart(recording)[0]) for recording in recordings)
    moved = _SPREAD * max(excess_of_link(recordings), apart) * _base(estimate)
    return estimate.widened(np.outer(moved, moved))


def with_hidden_spring(
    estimate: Estimate, recordings: Sequence[Recording], known: Mapping[str, float]
) -> tuple[Estimate, float]:
    """Return the estimate with the doubt of a spring behind the only encoder.

    Returns the standard deviation of the inertia by this doubt as well, over the inertia. `known`
    are coefficients and delays that were not estimated.
    """
    moved = _PART * by_hidden_spring(estimate, recordings, known)
    gain = estimate.names.index("beta1")
    share = abs(float(moved[gain] / estimate.values[gain]))
    return estimate.widened(np.outer(moved, moved)), share


_GRAVITY = {"gamma1", "gamma_cosine"}
_FREE_FALL = 9.81  # m/s²
_NEAREST = 0.02  # m: the centre of mass of a link is hardly nearer to its axis
_SWING = 0.5  # rad; over less, a sine differs from a spring's straight line by 1 % at most


def gravity_of(estimate: Estimate) -> dict[str, float]:
    """Return the coefficients of gravity, of all logs."""
    found = estimate.by_name.items()
    return {name: value for name, value in found if name.partition("[")[0] in _GRAVITY}


def like_a_spring(estimate: Estimate, recordings: Sequence[Recording]) -> Caution | None:
    """Return the doubt that gravity is the spring of a clamped link; None if there is none.

    The inertia m l² of a mass at the distance l from the axis is at most the whole inertia. So
    gravity over the inertia is at most g / l.
    """
    pull = max(map(abs, gravity_of(estimate).values()), default=0.0)
    places = np.concatenate([recording.motor_position for recording in recordings])
    if pull * _NEAREST <= _FREE_FALL or np.ptp(places) > _SWING:
        return None
    return Caution(
        f"gravity pulls as if all mass was within {1e3 * _FREE_FALL / pull:.2g} mm of the axis, so "
        f"it may be the spring: if the link is clamped, write link_position = 0 in a column map",
        Rank.MODEL,
    )


def _base(estimate: Estimate) -> FloatArray:
    """Return the values of coefficients, shape (k,); zero for delays."""
    base = [name.partition("[")[0] in RIGID_UNITS for name in estimate.names]
    return np.where(base, estimate.values, 0.0)


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
        band = slice(1 + _end_of_band(drive))
        weight = (np.conj(drive) * frequency**2)[band]
        more += float(np.sum(weight * bends[band]).real)
        motor += float(np.sum(weight * moves[band]).real)
    return abs(more / motor) if motor else 0.0


def by_hidden_spring(
    estimate: Estimate, recordings: Sequence[Recording], known: Mapping[str, float]
) -> FloatArray:
    """Return the change of each value, shape (k,), if the inertia grows with the frequency.

    The torque's spectrum has the columns of the estimate, with and without c. In the instruments
    the input replaces the acceleration, whose noise would reduce the inertia. The change is zero if
    c is negative or explains no more than chance.
    """
    acts = {name for name, value in {**known, **estimate.by_name}.items() if value != 0.0}
    names = ["beta1", *(name for name in _REGRESSORS if name in acts)]
    delay = {**known, **estimate.by_name}.get(INPUT, 0.0)
    parts = [_in_band(recording, names, delay) for recording in recordings]
    torque, columns, instruments = (
        np.concatenate(part, axis=-1) for part in zip(*parts, strict=True)
    )
    (whole, deviations), (bare, _) = (
        _instrumental(torque, columns[first:], instruments[first:]) for first in (0, 1)
    )
    if not (whole[1] > 0.0 and whole[0] > _BY_CHANCE * deviations[0]):
        return np.zeros(len(estimate.names))
    found = dict(zip(names, (whole[1:] - bare) / whole[1], strict=True)) | {"beta1": 0.0}
    own = np.array([found.get(name, 0.0) for name in estimate.names])
    return (bare[0] / whole[1] - 1.0) * _base(estimate) + own


def _in_band(
    recording: Recording, names: Sequence[str], delay: float
) -> tuple[_Spectrum, _Spectrum, _Spectrum]:
    """Return a recording's torque (n,), columns and instruments (1 + k, n) in the input's band."""
    moving = with_velocities(recording)
    assert moving.motor_velocity is not None
    motion = moving.motor_position, moving.motor_velocity
    turns = 2.0 * np.pi * np.fft.rfftfreq(len(recording), recording.sample_time)
    torque = _spectrum(recording.needed_input)
    band = slice(_LOBE, 1 + _end_of_band(torque))
    torque *= np.exp(-1j * turns * delay)
    rest = [_spectrum(_REGRESSORS[name](*motion)) for name in names[1:]]
    acceleration = -(turns**2) * _spectrum(motion[0])
    columns, instruments = (
        np.array([turns**2 * first, first, *rest])[:, band] for first in (acceleration, torque)
    )
    return torque[band], columns, instruments


def _instrumental(
    wanted: _Spectrum, columns: _Spectrum, instruments: _Spectrum
) -> tuple[FloatArray, FloatArray]:
    """Return real factors of complex columns, shape (k, n), and their standard deviations."""
    goal = np.concatenate((wanted.real, wanted.imag))
    of, by = (np.hstack((each.real, each.imag)).T for each in (columns, instruments))
    sizes, weights = (np.maximum(np.linalg.norm(each, axis=0), _TINY) for each in (of, by))
    of, by = of / sizes, by / weights
    inverse = np.linalg.pinv(by.T @ of)
    factors = inverse @ (by.T @ goal)
    scatter = (inverse @ by.T) * (goal - of @ factors)
    return factors / sizes, np.sqrt(_WINDOW * np.sum(scatter**2, axis=1)) / sizes


def _end_of_band(spectrum: _Spectrum) -> int:
    """Return the place up to which a spectrum has most of its power."""
    power = np.cumsum(np.abs(spectrum) ** 2)
    return int(np.searchsorted(power, _BAND * power[-1]))


def _spectrum(values: FloatArray) -> _Spectrum:
    """Return the spectrum of a channel without its trend."""
    line = np.polyval(np.polyfit(np.arange(len(values)), values, 1), np.arange(len(values)))
    return np.fft.rfft((values - line) * np.hanning(len(values)))
