"""Detection of channels with the wrong sign, relative to the motor's position.

With link and motor position smoothed by one kernel as in `slow_motion`, the mechanics are

    link - motor     = -(J link'' + g sin(link + angle)) / k + a link' + b sign(link') + c,
    torque           =  (J + M) motor'' + J (link - motor)'' + g sin(link + angle) + friction,

so a deflection opposes the link's acceleration, and a torque has the sign of the motor's
acceleration. If a log shows the opposite, a sign is wrong: stiffness and inertia are positive,
and a drive cannot return more energy than it received.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.recording import INPUTS, Draft, Rank, Recording
from flexid.recording.slow_motion import PARTS, Smoothing, left_over, own_share, smoothing

_OPPOSITE = -0.98  # correlation of link and motor of about the same amplitude
_SIZE_RATIO = 1.1  # of link and motor: a soft joint near its resonance moves one side more
_CERTAIN = 5.0  # standard errors
_DISSIPATED = 0.02  # friction's least share of the absolute work: more in 54 of 56 trials
_MOST_LEFT = 0.5  # largest residual over the signal, as squares, of a deflection or an input
_BETTER_FIT = 0.5  # residual after over before a change of sign: at most 0.33 if it is needed


def reversed_channels(log: Draft, recording: Recording, *, alone: bool) -> Iterator[str]:
    """Yield the names of channels with the wrong sign, with a warning.

    An input is tested only if the joint is `alone`: inputs of an arm also move other joints.
    """
    if _is_reversed_link(recording):
        yield from _warn_of_sign(log, "link_position", "it moves against the motor's position")
    elif _is_reversed_deflection(recording):
        why = "by the link's acceleration it is motor minus link position"
        yield from _warn_of_sign(log, "deflection", why)
    elif alone and _is_reversed_input(recording):
        name = next(name for name in INPUTS if name in log.channels)
        yield from _warn_of_sign(log, name, "it acts against the motor's acceleration")


def change_signs(log: Draft, names: list[str]) -> None:
    """Change the sign of channels, in their values and in their origins."""
    for name in names:
        channel = log.channels[name]
        factor, offset = -channel.origin.factor, 0.0 - channel.origin.offset
        origin = replace(channel.origin, factor=factor, offset=offset)
        log.channels[name] = replace(channel, values=-channel.values, origin=origin)


def _warn_of_sign(log: Draft, name: str, why: str) -> Iterator[str]:
    """Warn of a channel with the wrong sign; yield it, and its velocity if that is wrong too."""
    names = [name]
    velocity = name.replace("position", "velocity")
    has_one = velocity != name and velocity in log.channels
    if has_one and log[velocity][1:] @ np.diff(log[name]) > 0.0:
        names.append(velocity)
    log.warn(
        names if len(names) > 1 else name,
        f"{' and '.join(names)} {'were' if len(names) > 1 else 'was'} taken with the other sign, "
        f"since {why}: check it, and reverse the sign of its scale in a column map (write "
        f"scale = -1 if it has none)",
        Rank.SCALE,
    )
    yield from names


def _is_reversed_link(recording: Recording) -> bool:
    """Whether the link's encoder counts in the opposite direction."""
    # Above the antiresonance the two sides do move in opposite directions, at resonance with the
    # same amplitude if their inertias are equal. Then the deflection as logged fits the mechanics.
    link = recording.link_position
    if link is None or recording.clamped or recording.link_from_deflection:
        return False
    if np.corrcoef(link, recording.motor_position)[0, 1] >= 0.0:
        return False
    return _fits_turned(recording, -link, otherwise=are_opposed(recording))


def are_opposed(recording: Recording) -> bool:
    """Whether link and motor positions are nearly opposite."""
    link, motor = recording.link_position, recording.motor_position
    if link is None or recording.clamped:
        return False
    ratio = float(motor.std() / link.std())
    is_opposed = np.corrcoef(link, motor)[0, 1] < _OPPOSITE
    return bool(is_opposed and 1.0 / _SIZE_RATIO < ratio < _SIZE_RATIO)


def _is_reversed_deflection(recording: Recording) -> bool:
    """Whether a measured deflection is the motor's position minus the link's."""
    is_measured = recording.link_from_deflection
    return is_measured and _fits_turned(recording, recording.motor_position - recording.deflection)


def _fits_turned(recording: Recording, turned_link: FloatArray, *, otherwise: bool = False) -> bool:
    """Whether the turned link fits the mechanics better; `otherwise` if neither sign fits."""
    smoothed = smoothing(recording)
    if smoothed is None:
        return otherwise
    as_logged, other = (
        _fit(
            smoothed(link - recording.motor_position),
            smoothed(link, 2),
            _resistance(recording, smoothed, link),
        )
        for link in (recording.needed_link_position, turned_link)
    )
    if not other.against:
        return otherwise and not as_logged.against
    return not as_logged.against or other.left < _BETTER_FIT * as_logged.left


def _is_reversed_input(recording: Recording) -> bool:
    """Whether an input opposes the motor's acceleration, and its work on the drive is negative."""
    # Each condition alone is possible. With one encoder, an elastic load may accelerate against an
    # input that does positive work. A load that is lowered returns work, but follows the input.
    smoothed = smoothing(recording)
    if smoothed is None or recording.input is None or recording.clamped:
        return False
    motor, link = recording.motor_position, recording.link_position
    others = _resistance(recording, smoothed, motor if link is None else link)
    if link is not None:
        others = [smoothed(link - motor, 2), *others]
    work = 0.5 * (recording.input[1:] + recording.input[:-1]) * np.diff(motor)
    if work.sum() >= -_DISSIPATED * np.abs(work).sum():
        return False
    return _fit(smoothed(recording.input), smoothed(motor, 2), others).against


class _Fit(NamedTuple):
    """Fit of a signal by the mechanics of the joint."""

    against: bool  # whether the signal opposes the acceleration with certainty
    left: float  # squares of the residual over those of the signal


def _fit(signal: FloatArray, acceleration: FloatArray, others: Sequence[FloatArray]) -> _Fit:
    """Fit a signal by an acceleration and other regressors."""
    share, error = own_share(signal, acceleration, others)
    size = left_over(signal)
    left = left_over(signal, [acceleration, *others]) / size if size else 1.0
    # Fewer samples are overfitted, and the jackknife then underestimates the error.
    is_enough = len(signal) >= PARTS * (len(others) + 2)
    against = is_enough and left < _MOST_LEFT and share < -_CERTAIN * error
    return _Fit(against, left)


def _resistance(recording: Recording, smoothed: Smoothing, moved: FloatArray) -> list[FloatArray]:
    """Regressors of gravity (of a linear axis: of a spring load) and of one side's friction."""
    turns = recording.joint == "revolute"
    load = [smoothed(np.sin(moved)), smoothed(np.cos(moved))] if turns else [smoothed(moved)]
    return [*load, smoothed(moved, 1), smoothed.sign(moved)]
