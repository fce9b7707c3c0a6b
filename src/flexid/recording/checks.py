"""Does a log make sense as that of a flexible joint? One small function per check."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.channel import INPUTS
from flexid.recording.velocities import is_noise

if TYPE_CHECKING:
    from collections.abc import Mapping

    from flexid.arrays import FloatArray
    from flexid.recording.channel import Channel

LARGEST_VALUE = 1e10  # in SI; a clock may count seconds since 1970
FASTEST_JOINT = 100.0  # rad/s at the link side of the gear, about 1000 rpm
DEGREES = 180.0 / np.pi
TURN = 2.0 * np.pi
_COPIED = 0.01  # of the signal, up to which a copy differs: the derivative of a noisy position does
_SAME = 0.02  # off 1, up to which a copy's factor is, in SI units or in the file's


def check_magnitude(file: str, name: str, channel: Channel) -> None:
    """Raise if a channel holds absurdly large values."""
    largest = max(float(channel.values.max()), -float(channel.values.min()))
    if not largest <= LARGEST_VALUE:
        raise RecordingError(
            file,
            f"column {channel.column!r}",
            f"{name} reaches {largest:.3g} {channel.unit}: correct the cell or the unit",
        )


def check_varies(file: str, name: str, channel: Channel) -> None:
    """Raise if a channel is constant over the whole log."""
    if np.ptp(channel.values) <= 1e-12 * max(1.0, float(np.abs(channel.values).max())):
        raise _dead(file, name, channel, "constant")


def check_moves(file: str, name: str, channel: Channel) -> None:
    """Raise if a position is white noise about a constant."""
    if is_noise(channel.values):
        noise = f"constant but for noise of {np.std(channel.values):.2g} rad"
        raise _dead(file, name, channel, noise)


def _dead(file: str, name: str, channel: Channel, what: str) -> RecordingError:
    cause = {
        "deflection": "the link moves as if rigidly tied to the motor, or the sensor is dead",
        "link_position": "the encoder is stuck or not connected",
        "motor_position": "the encoder is stuck or not connected",
        "link_velocity": "the sensor is dead, so leave the column out",
        "motor_velocity": "the sensor is dead, so leave the column out",
    }.get(name, "nothing drives the motor; without the column the link is identified alone")
    return RecordingError(
        file,
        f"column {channel.column!r}",
        f"{name} is {what} and carries no information ({cause}): record it while it moves",
    )


def check_copy(file: str, name: str, channels: Mapping[str, Channel], time: FloatArray) -> None:
    """Raise if an input is the same signal as another channel, or as a position's derivative."""
    drive = channels[name]
    values, clock = drive.values - drive.values.mean(), time - time.mean()
    total = np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))))
    for other, channel in channels.items():
        if other in INPUTS:
            continue
        units = drive.origin.factor / channel.origin.factor  # the file's, in which it was copied
        for copied, what in ((values, other), (total, f"the derivative of {other}")):
            matrix = np.column_stack((copied, clock, np.ones_like(clock)))
            moved = channel.values - channel.values.mean()
            solution = np.linalg.lstsq(matrix, moved, rcond=None)[0]
            off = float(np.std(moved - matrix @ solution))
            explained = abs(float(solution[0])) * float(np.std(copied))
            if off < _COPIED * explained and any(
                abs(slope - 1.0) < _SAME for slope in (solution[0], solution[0] * units)
            ):
                raise RecordingError(
                    file,
                    f"columns {drive.column!r} and {channel.column!r}",
                    f"{name} is the same signal as {what}, to {100.0 * off / explained:.1g} %: "
                    f"name the column of the input in a column map",
                )


def check_two_encoders(file: str, link: Channel, motor: Channel) -> None:
    """Raise if link and motor position are the same signal."""
    difference = link.values - motor.values
    if np.ptp(difference) <= 1e-12 * max(1.0, float(np.abs(link.values).max())):
        raise RecordingError(
            file,
            f"columns {link.column!r} and {motor.column!r}",
            "link and motor position are one and the same signal, so nothing is known of the "
            "spring: log the second encoder",
        )


def check_speed(file: str, name: str, channel: Channel, time: FloatArray) -> tuple[str, ...]:
    """Warn of, or refuse where no unit was stated, a position that turns implausibly fast."""
    lag = min(10, len(time) - 1)
    changes = np.abs(channel.values[lag:] - channel.values[:-lag]) / (time[lag:] - time[:-lag])
    fast = float(np.quantile(changes, 0.95))
    if fast <= FASTEST_JOINT:
        return ()
    place = f"column {channel.column!r}"
    found = f"{name} turns at {fast:.3g} rad/s, faster than a joint does at the link side"
    if channel.unit_stated:
        return (f"{file}: {place}: {found}: check the unit and the gear ratio",)
    raise RecordingError(file, place, f"{found}: name its unit in the header, as in {name} [deg]")


def unwrap(file: str, name: str, channel: Channel, time: FloatArray) -> tuple[FloatArray, str]:
    """Undo the wraps of an absolute encoder.

    Parameters
    ----------
    file, name : str
        For messages.
    channel : Channel
        A position.
    time : FloatArray, shape (n,)

    Returns
    -------
    values : FloatArray, shape (n,)
        Without jumps by a turn.
    warning : str
        Empty if there was none.

    Raises
    ------
    RecordingError
        If it jumps, but not clearly by whole turns.
    """
    values = channel.values
    steps = np.diff(values)
    clock = np.diff(time)
    # A position may be another after a gap: there only a turn of the link's side is a wrap.
    within = clock <= 1.5 * np.median(clock) if len(clock) else np.zeros(0, dtype=bool)
    turn = _turn(channel, steps[within])
    seen = within | (turn == TURN)
    is_jump = (np.abs(steps) > turn / 2) & seen
    if not is_jump.any():
        return values, ""
    jumps = np.flatnonzero(is_jump)
    if turn == TURN and len(jumps) > len(steps) // 4:
        return values, ""  # not wraps but a wrong unit, which the check of the speed will tell
    turns = np.rint(steps[jumps] / turn)
    left_over = np.abs(steps[jumps] - turn * turns).max()
    others = np.abs(steps[~is_jump & seen]).max(initial=0.0)
    place = f"column {channel.column!r}"
    times = ", ".join(f"{time[index + 1]:.6g} s" for index in jumps[:3])
    if len(jumps) > 3:
        times += f" and {len(jumps) - 3} more times"
    if left_over > turn / 4 or others > turn / 4:
        raise RecordingError(
            file,
            place,
            f"{name} jumps by {abs(steps[jumps[0]]):.3g} rad at {times}, which is no whole turn of "
            f"an encoder: check the unit and the gear ratio, or remove the outlier"
            + ("" if turn == TURN else "; if the encoder wraps, unwrap it, or log faster"),
        )
    corrections = np.zeros_like(steps)
    corrections[jumps] = turn * turns
    unwrapped = values - np.concatenate(([0.0], np.cumsum(corrections)))
    warning = f"{file}: {place}: {name} jumps by a turn at {times}, and was unwrapped: check it"
    return unwrapped, warning


def _turn(channel: Channel, steps: FloatArray) -> float:
    """What an encoder wraps by, as the link's side of the gear sees it.

    Behind a gear that is a turn of the motor, or the whole turns that a counter holds, where the
    position jumps by them and stays within them. A log that is sampled so slowly that the motor
    makes half a turn between two samples does not.
    """
    gear = channel.origin.gear_ratio
    if not gear or not len(steps):
        return TURN
    turn = TURN / abs(gear)
    turns = round(float(np.abs(steps).max()) / turn)
    wraps = turns >= 1 and float(np.ptp(channel.values)) < (turns + 0.01) * turn
    return turns * turn if wraps else TURN


def turns_apart(position: FloatArray, other: FloatArray) -> float:
    """Whole turns that one side is behind the other, in rad.

    Encoders that wrap do not say in which turn they began.
    """
    return TURN * float(np.rint(np.median(other - position) / TURN))


def check_jumps(file: str, name: str, channel: Channel, time: FloatArray) -> tuple[str, ...]:
    """Warn of a position that jumps across its range, as a counter does that overflows.

    What a whole turn of it is, is not known, or it would have been unwrapped. A position may be
    another after a gap, and one of a few counts is no jump.
    """
    values = channel.values
    clock = np.diff(time)
    steps = np.where(clock > 1.5 * np.median(clock), 0.0, np.abs(np.diff(values)))
    extent = float(np.ptp(values))
    is_jump = steps > 0.5 * extent
    jumps = np.flatnonzero(is_jump)
    if (
        not len(jumps)
        or steps[~is_jump].max(initial=0.0) > 0.25 * extent
        or len(np.unique(values)) <= 20
    ):
        return ()
    times = ", ".join(f"{time[index + 1]:.6g} s" for index in jumps[:3])
    if len(jumps) > 3:
        times += f" and {len(jumps) - 3} more times"
    return (
        f"{file}: column {channel.column!r}: {name} jumps by more than half of its range at "
        f"{times}: if a counter overflows, unwrap it, or write the gear_ratio in a column map; if "
        f"it is an outlier, remove it",
    )


def check_saturation(file: str, name: str, channel: Channel) -> tuple[str, ...]:
    """Warn of a channel that rests at its largest or smallest value again and again.

    A sensor at its limit returns the limit exactly, much more often than the next value, and on
    several occasions; an input that is switched between few levels is no fault.
    """
    values = channel.values
    levels, counts = np.unique(values, return_counts=True)
    if len(levels) <= 20:
        return ()
    for level, count, beside in (
        (levels[0], counts[0], counts[1]),
        (levels[-1], counts[-1], counts[-2]),
    ):
        share = count / len(values)
        at_limit = np.concatenate(([False], values == level, [False]))
        starts = np.flatnonzero(at_limit[1:] & ~at_limit[:-1])
        if share > 0.01 and count > 10 * beside and len(starts) >= 2 and count >= 3 * len(starts):
            return (
                f"{file}: column {channel.column!r}: {name} stands at its extreme of "
                f"{level:.4g} {channel.unit} in {100.0 * share:.2g} % of the samples, as if "
                f"clipped: reduce the amplitude or widen the sensor's range",
            )
    return ()


def check_follow(file: str, link: Channel, motor: Channel) -> tuple[str, ...]:
    """Check that link and motor position are angles at the same side of the gear.

    A joint near its resonance moves one side several times as much as the other, so that only
    clear cases are refused.
    """
    link_part = link.values - link.values.mean()
    motor_part = motor.values - motor.values.mean()
    link_size = float(np.sqrt(np.mean(link_part**2)))
    motor_size = float(np.sqrt(np.mean(motor_part**2)))
    correlation = float(np.mean(link_part * motor_part)) / (link_size * motor_size)
    place = f"columns {link.column!r} and {motor.column!r}"
    ratio = motor_size / link_size
    larger, smaller = ("motor", "link") if ratio > 1.0 else ("link", "motor")
    factor = max(ratio, 1.0 / ratio)
    if abs(correlation) > 0.98 and abs(factor / DEGREES - 1.0) < 0.05:
        raise RecordingError(
            file,
            place,
            f"the {larger} position is about 57.3 times the {smaller} position, so one is in "
            f"degrees and the other in radians: write the unit in brackets",
        )
    if abs(correlation) > 0.98 and factor > 20.0:
        remedy = f"scale the link position by {1.0 / factor:.3g}"
        if larger == "motor":
            remedy = "write the drive's gear_ratio"
        raise RecordingError(
            file,
            place,
            f"the {larger} position is about {factor:.3g} times the {smaller} position, as if by a "
            f"gear: {remedy} in a column map",
        )
    if correlation < -0.98 and factor < 1.1:
        raise RecordingError(
            file,
            place,
            "link and motor position turn in opposite directions: scale one by -1 in a column map",
        )
    warnings = []
    if factor > 4.0:
        warnings.append(
            f"{file}: {place}: the {larger} position moves {factor:.2g} times as much as the "
            f"{smaller} position: check the gear ratio and the units"
        )
    if abs(correlation) < 0.3:
        warnings.append(
            f"{file}: {place}: link and motor position hardly follow each other (correlation "
            f"{correlation:.2f}): check that they belong to one joint, and the gear ratio"
        )
    return tuple(warnings)
