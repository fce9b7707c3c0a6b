"""Measured velocities held against the derivatives of their positions."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.caution import Rank
from flexid.recording.draft import Draft
from flexid.recording.recording import Recording
from flexid.recording.velocities import position_noise

_ACCURACY = 50.0  # a window's motion over the noise of its two ends: 2 %
_SHORTEST = 40  # windows that a recording has to hold
_MOST_OFF = 0.1  # of the velocity's size, up to which it is used: what noise and filters make
_MOST_SCALED = 0.03  # of the scale, the same: 1 % where a filter takes the fast part away
_CLEAR = 5e-3  # s, a delay that is named
_KNOWN = {
    180.0 / np.pi: "deg/s, so write the unit [deg/s]",
    np.pi / 180.0: "rad/s and the position in degrees, so write the units",
    30.0 / np.pi: "rpm, so write the unit [rpm]",
    -1.0: "the opposite direction, so scale it by -1 in a column map",
}


def is_used(log: Draft, name: str, recordings: Sequence[Recording]) -> bool:
    """Whether a measured velocity is the derivative of its position; a warning where it is not."""
    means = [found for one in recordings if (found := _means(one, name)) is not None]
    if not means:
        return True  # it hardly moves, so nothing can be said
    measured, own, other, change = (np.concatenate(parts) for parts in zip(*means, strict=True))
    size = float(np.sqrt(own @ own))
    slope = float(own @ measured) / size**2
    place = log.channels[name].place
    for factor, remedy in _KNOWN.items():
        if abs(slope / factor - 1.0) < 0.1 and _share(measured - slope * own, measured) < 0.4:
            reason = f"{name} is {slope:.3g} times the position's derivative: it is {remedy}"
            raise log.refusal(place, reason)
    off = _share(measured - own, own)
    if off <= _MOST_OFF and abs(slope - 1.0) <= _MOST_SCALED:
        return True
    scale, side, late = np.linalg.lstsq(
        np.column_stack((own, other - own, -change)), measured, rcond=None
    )[0]
    explained = _share(measured - scale * own - side * (other - own) + late * change, own)
    cause = ""
    if explained < 0.5 * off:
        if abs(side) > 0.5:
            cause = ", and follows the other side of the joint"
        elif abs(late) > _CLEAR and abs(late) * _share(change, own) > abs(scale - 1.0):
            cause = f", as if it were {abs(1e3 * late):.0f} ms {'late' if late > 0.0 else 'early'}"
        else:
            cause = f", as if it were scaled by {scale:.3g}"
    log.warn(
        place,
        f"{name} differs from the derivative of its position by {100 * off:.0f} % RMS{cause}: it "
        f"is not used, and derived from the position instead; correct the column, or leave it out",
        Rank.SCALE,
    )
    return False


class _Means(NamedTuple):
    """Window means, about their mean over the recording, in rad/s, each of shape (n,)."""

    measured: FloatArray  # velocity
    own: FloatArray  # derivative of its position
    other: FloatArray  # that of the other side
    change: FloatArray  # of `own` in a second, in rad/s^2


def _means(recording: Recording, name: str) -> _Means | None:
    """Means over the shortest windows that noise allows; None where it allows none."""
    velocity = getattr(recording, name)
    position = getattr(recording, name.replace("velocity", "position"))
    link, motor = recording.link_position, recording.motor_position
    opposite = motor if name.startswith("link") or link is None else link
    noise = np.sqrt(2.0) * position_noise(position)
    window = 1
    while np.std(position[window:] - position[:-window]) < _ACCURACY * noise:
        window *= 2
        if window * _SHORTEST > len(position):
            return None
    if window * _SHORTEST > len(position):
        return None
    span = window * recording.sample_time
    total = np.concatenate(([0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1]))))
    measured, own, other = (
        (values[window:] - values[:-window]) / span
        for values in (recording.sample_time * total, position, opposite)
    )
    step = max(1, window // 2)
    change = (own[2 * step :] - own[: -2 * step]) / (2.0 * step * recording.sample_time)
    thinned = slice(step, len(own) - step, step)
    first, second, third = (x[thinned] - x[thinned].mean() for x in (measured, own, other))
    return _Means(first, second, third, change[::step])


def _share(part: FloatArray, whole: FloatArray) -> float:
    """Size of a part over that of the whole."""
    return float(np.sqrt((part @ part) / (whole @ whole)))
