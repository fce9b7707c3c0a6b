"""Confidence bands of a frequency response: all that coefficients within their ellipsoid give.

Beside a resonance the logarithm of a response is anything but linear in the coefficients, and the
delta method gives bands that are too narrow below the peak and too wide above. So the response is
computed for coefficients c + r S w, with S Sᵀ their covariance, r the quantile of Student's t and
|w| ≤ 1. Among all w those count that lie in the plane of the two directions in which, at that
frequency, magnitude and phase change: to all others the response is, to first order, indifferent.
"""

from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.frequency.linear_joint import ComplexArray, LinearJoint
from flexid.identification.vocabulary.intervals import quantile

_RADII = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
_ANGLES = 2.0 * np.pi * np.arange(32) / 32  # the largest response is missed by 0.5 % of the width
_TURN = 2.0  # rad between neighbours, from which on the response vanishes, or peaks, between them


@dataclass(frozen=True, eq=False)
class Band:
    """Ends of the interval at each frequency; infinite where the log leaves something free."""

    lower: FloatArray  # (n, n_rows): magnitude over its estimate
    upper: FloatArray  # likewise
    behind: FloatArray  # (n, n_rows): rad, phase less its estimate
    ahead: FloatArray  # likewise


def response_band(joint: LinearJoint, omega: FloatArray, level: float) -> Band:
    """Interval of magnitude and phase of each position at each frequency."""
    if joint.unknown:
        ends = (np.tile(part[:, None], joint.rows) for part in _of_nothing(len(omega)))
        return Band(*ends)
    response = joint.positions(omega)
    with np.errstate(divide="ignore", invalid="ignore"):  # of what does not move at all
        slopes = joint.logarithmic_slopes(omega)
    bands = [
        _of_row(joint, omega, response, slopes, row, level)
        if response[:, row].all()
        else _of_nothing(len(omega))
        for row in range(joint.rows)
    ]
    return Band(*(np.stack(ends, axis=1) for ends in zip(*bands, strict=True)))


def _of_nothing(count: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Of a response that is zero: nothing is known of its logarithm."""
    everything = np.full(count, np.inf)
    return np.zeros(count), everything, -everything, everything


def _of_row(
    joint: LinearJoint,
    omega: FloatArray,
    response: ComplexArray,
    slopes: ComplexArray,
    row: int,
    level: float,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    change = slopes[:, row] @ joint.deviations
    if change.shape[1] == 0:  # nothing was estimated
        none = np.zeros(len(omega))
        return none + 1.0, none + 1.0, none, none
    # The first axis lies along the change of the magnitude, which so is met exactly.
    planes = np.linalg.qr(np.stack((change.real, change.imag), axis=2)).Q
    rays = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)), axis=1)[:, : planes.shape[2]]
    reach = quantile(joint.degrees_of_freedom, level)
    moves = np.einsum("ki,nij,aj->nak", joint.deviations, planes, rays)[:, :, None]
    moves = reach * _RADII[:, None] * moves
    at = np.broadcast_to(omega[:, None, None], moves.shape[:3])
    ratio = joint.positions(at, joint.values + moves)[..., row] / response[:, row, None, None]
    turned = np.angle(ratio[:, :, 1:] / ratio[:, :, :-1])
    angles = np.cumsum(turned, axis=2)  # from the middle outwards
    between = np.angle(np.exp(1j * np.diff(angles[:, [*range(len(rays)), 0], -1], axis=1)))
    any_phase = (np.abs(turned) > _TURN).any(axis=(1, 2)) | (np.abs(between.sum(axis=1)) > np.pi)
    with np.errstate(divide="ignore"):  # of a joint without damping
        largest = 1.0 / _nearest(1.0 / ratio)
    return (
        _nearest(ratio),
        largest,
        np.where(any_phase, -np.pi, np.minimum(angles.min(axis=(1, 2)), 0.0)),
        np.where(any_phase, np.pi, np.maximum(angles.max(axis=(1, 2)), 0.0)),
    )


def _nearest(points: ComplexArray) -> FloatArray:
    """How near the lines between points along each ray come to zero, shape (n,)."""
    start, step = points[:, :, :-1], np.diff(points, axis=2)
    length = np.abs(step) ** 2
    along = -(start * step.conj()).real / np.where(length > 0.0, length, 1.0)
    return np.abs(start + np.clip(along, 0.0, 1.0) * step).min(axis=(1, 2))
