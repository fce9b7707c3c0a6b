"""Channels that are counted against the motor's direction, which the drive's mechanics tell.

Of link and motor, smoothed alike as in `slow_motion`,

    link - motor     = -(J link'' + g sin(link + angle)) / k + a link' + b sign(link') + c,
    torque           =  (J + M) motor'' + J (link - motor)'' + g sin(link + angle) + friction,

so that a deflection goes against the link's acceleration, and a torque with the motor's. Where the
log says the opposite, a sign is wrong: no spring and no inertia is negative, and no drive gives
back more than was put into it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.recording import INPUTS, Draft, Rank, Recording
from flexid.recording.slow_motion import PARTS, Smoothing, left_over, own_share, smoothing

_OPPOSITE = -0.98  # correlation of link and motor, whose sizes are alike
_ALIKE = 1.1  # sizes of link and motor: a soft joint near its resonance moves one side more
_CERTAIN = 5.0  # standard errors
_DISSIPATED = 0.02  # of the work to and fro, what friction takes: more in 54 of 56 trials
_EXPLAINED = 0.5  # of the squares of a deflection or an input, left over at most
_LIKELIER = 0.5  # of what a deflection leaves over as it is: at most 0.33 if it has to be turned


def reversed_channels(log: Draft, recording: Recording, *, alone: bool) -> Iterator[str]:
    """Name channels that count against the motor's direction, and say so.

    An arm's inputs move other joints, too, so that only a joint that is `alone` tells of its own.
    """
    if _is_reversed_link(recording):
        yield from _named(log, "link_position", "it moves against the motor's position")
    elif _is_reversed_deflection(recording):
        why = "as it is it does not pull the link, and it is the link's position less the motor's"
        yield from _named(log, "deflection", why)
    elif alone and _is_reversed_input(recording):
        name = next(name for name in INPUTS if name in log.channels)
        yield from _named(log, name, "it pulls against the way in which the motor accelerates")


def turned(log: Draft, names: list[str]) -> None:
    """Turn channels to the motor's direction, in their values and in what is told of them."""
    for name in names:
        channel = log.channels[name]
        factor, offset = -channel.origin.factor, 0.0 - channel.origin.offset
        origin = replace(channel.origin, factor=factor, offset=offset)
        log.channels[name] = replace(channel, values=-channel.values, origin=origin)


def _named(log: Draft, name: str, why: str) -> Iterator[str]:
    """Say of a channel, and of a velocity that goes with it, why it is turned."""
    names = [name]
    velocity = name.replace("position", "velocity")
    has_one = velocity != name and velocity in log.channels
    if has_one and log[velocity][1:] @ np.diff(log[name]) > 0.0:
        names.append(velocity)
    log.warn(
        names if len(names) > 1 else name,
        f"{' and '.join(names)} {'were' if len(names) > 1 else 'was'} taken with the other sign, "
        f"since {why}: check the sign, and change that of the scale in a column map (write "
        f"scale = -1 where there is none)",
        Rank.SCALE,
    )
    yield from names


def _is_reversed_link(recording: Recording) -> bool:
    """Whether two encoders count in opposite directions.

    Beyond the link's own resonance a joint's sides do move against each other, as far as each other
    where they weigh the same, and bend it as its spring does.
    """
    link = recording.link_position
    if link is None or recording.clamped or recording.link_from_deflection:
        return False
    if np.corrcoef(link, recording.motor_position)[0, 1] >= 0.0:
        return False
    return _pulls_better(recording, -link, otherwise=are_opposed(recording))


def are_opposed(recording: Recording) -> bool:
    """Whether link and motor make one motion in opposite directions."""
    link, motor = recording.link_position, recording.motor_position
    if link is None or recording.clamped:
        return False
    ratio = float(motor.std() / link.std())
    is_opposed = np.corrcoef(link, motor)[0, 1] < _OPPOSITE
    return bool(is_opposed and 1.0 / _ALIKE < ratio < _ALIKE)


def _is_reversed_deflection(recording: Recording) -> bool:
    """Whether a measured deflection is the motor's position less the link's."""
    is_measured = recording.link_from_deflection
    return is_measured and _pulls_better(recording, recording.motor_position - recording.deflection)


def _pulls_better(
    recording: Recording, turned_link: FloatArray, *, otherwise: bool = False
) -> bool:
    """Whether the spring's deflection pulls the link as it should only with the link turned.

    What is `otherwise` is so where it does with neither sign.
    """
    smoothed = smoothing(recording)
    if smoothed is None:
        return otherwise
    as_it_is, other = (
        _explained(
            smoothed(link - recording.motor_position),
            smoothed(link, 2),
            _resisting(recording, smoothed, link),
        )
        for link in (recording.needed_link_position, turned_link)
    )
    if not other.against:
        return otherwise and not as_it_is.against
    return not as_it_is.against or other.left < _LIKELIER * as_it_is.left


def _is_reversed_input(recording: Recording) -> bool:
    """Whether an input pulls against the motor's acceleration, and takes work out of the drive.

    Of a drive with one encoder an elastic load may accelerate against the input, which then still
    does work; a load that is let down gives work back, and accelerates with the input.
    """
    smoothed = smoothing(recording)
    if smoothed is None or recording.input is None or recording.clamped:
        return False
    motor, link = recording.motor_position, recording.link_position
    others = _resisting(recording, smoothed, motor if link is None else link)
    if link is not None:
        others = [smoothed(link - motor, 2), *others]
    work = 0.5 * (recording.input[1:] + recording.input[:-1]) * np.diff(motor)
    if work.sum() >= -_DISSIPATED * np.abs(work).sum():
        return False
    return _explained(smoothed(recording.input), smoothed(motor, 2), others).against


class _Explained(NamedTuple):
    """What mechanics explain of a signal."""

    against: bool  # whether it certainly goes against the acceleration
    left: float  # of its squares, what nothing explains


def _explained(
    signal: FloatArray, acceleration: FloatArray, others: Sequence[FloatArray]
) -> _Explained:
    """How much of a signal the acceleration and others explain, and to which side."""
    share, error = own_share(signal, acceleration, others)
    size = left_over(signal)
    left = left_over(signal, [acceleration, *others]) / size if size else 1.0
    # Fewer are fitted by anything, and parts of them then tell of no error.
    is_enough = len(signal) >= PARTS * (len(others) + 2)
    against = is_enough and left < _EXPLAINED and share < -_CERTAIN * error
    return _Explained(against, left)


def _resisting(recording: Recording, smoothed: Smoothing, moved: FloatArray) -> list[FloatArray]:
    """Gravity, or a spring that a slide pushes on, and friction of a side, of unknown sizes."""
    turns = recording.joint == "revolute"
    load = [smoothed(np.sin(moved)), smoothed(np.cos(moved))] if turns else [smoothed(moved)]
    return [*load, smoothed(moved, 1), smoothed.sign(moved)]
