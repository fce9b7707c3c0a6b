"""Does a log make sense as that of a flexible joint? One small function per check."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.velocities import position_noise

if TYPE_CHECKING:
    from flexid.arrays import FloatArray
    from flexid.recording.channel import Channel
    from flexid.recording.recording import Recording

LARGEST_VALUE = 1e10  # in SI; a clock may count seconds since 1970
FASTEST_JOINT = 100.0  # rad/s at the link side of the gear, about 1000 rpm
DEGREES = 180.0 / np.pi
TURN = 2.0 * np.pi


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
    values = channel.values
    if np.ptp(values) > 1e-12 * max(1.0, float(np.abs(values).max())):
        return
    cause = {
        "deflection": "the link moves as if rigidly tied to the motor, or the sensor is dead",
        "link_position": "the encoder is stuck or not connected",
        "motor_position": "the encoder is stuck or not connected",
        "link_velocity": "the sensor is dead, so leave the column out",
        "motor_velocity": "the sensor is dead, so leave the column out",
    }.get(name, "nothing drives the motor; without the column the link is identified alone")
    raise RecordingError(
        file,
        f"column {channel.column!r}",
        f"{name} is constant and carries no information ({cause}): record it while it moves",
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


def check_frozen(
    file: str, name: str, channel: Channel, other: FloatArray, time: FloatArray
) -> tuple[str, ...]:
    """Warn of stretches in which one sensor does not change while the other position moves."""
    values = channel.values
    starts = np.concatenate(([0], np.flatnonzero(np.diff(values) != 0.0) + 1, [len(values)]))
    lengths = np.diff(starts)
    shortest = max(20, len(values) // 50)
    moved = max(0.1 * float(np.ptp(other)), 20.0 * position_noise(other))
    frozen = [
        f"{time[start]:.6g} s to {time[start + length - 1]:.6g} s"
        for start, length in zip(starts[:-1], lengths, strict=True)
        if length >= shortest and np.ptp(other[start : start + length]) > moved
    ]
    if not frozen:
        return ()
    times = ", ".join(frozen[:3]) + (f" and {len(frozen) - 3} more" if len(frozen) > 3 else "")
    return (
        f"{file}: column {channel.column!r}: {name} does not change from {times}, while the "
        f"other side moves: check the sensor, or cut that stretch out",
    )


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


def check_derivative(
    file: str, name: str, channel: Channel, positions: list[FloatArray], recordings: list[Recording]
) -> tuple[str, ...]:
    """Check that a measured velocity is the derivative of its position.

    The integral of the velocity is compared with the position, both without their linear trend
    where the position is more than a trend, so that an offset of the velocity does no harm.

    Parameters
    ----------
    file, name : str
        For messages.
    channel : Channel
        The velocity, for its column.
    positions : list of FloatArray
        The position of each recording.
    recordings : list of Recording

    Returns
    -------
    tuple of str
        Warnings.

    Raises
    ------
    RecordingError
        If the two are clearly not position and derivative.
    """
    products, position_squares, integral_squares, noise_squares = 0.0, 0.0, 0.0, 0.0
    for position, recording in zip(positions, recordings, strict=True):
        velocity = getattr(recording, name)
        integral = np.concatenate(
            ([0.0], np.cumsum(0.5 * (velocity[1:] + velocity[:-1])) * recording.sample_time)
        )
        q, v = _without_trend(position, integral)
        products += float(q @ v)
        position_squares += float(q @ q)
        integral_squares += float(v @ v)
        noise_squares += len(q) * position_noise(position) ** 2
    if position_squares < 400.0 * noise_squares or integral_squares == 0.0:
        return ()  # it hardly moves, so nothing can be said
    slope = products / position_squares
    correlation = products / np.sqrt(position_squares * integral_squares)
    place = f"column {channel.column!r}"
    known = {
        DEGREES: "deg/s, so write the unit [deg/s]",
        1.0 / DEGREES: "rad/s and the position in degrees, so write the units",
        60.0 / TURN: "rpm, so write the unit [rpm]",
        -1.0: "the opposite direction, so scale it by -1 in a column map",
    }
    for factor, remedy in known.items():
        if abs(slope / factor - 1.0) < 0.1 and abs(correlation) > 0.9:
            raise RecordingError(
                file,
                place,
                f"{name} is {slope:.3g} times the position's derivative: it is {remedy}",
            )
    if correlation < 0.5 or not 0.8 < slope < 1.25:
        raise RecordingError(
            file,
            place,
            f"{name} is not the derivative of the position (slope {slope:.3g}, correlation "
            f"{correlation:.2f}): correct its unit, or leave it out and have it derived",
        )
    if abs(slope - 1.0) > 0.03 or correlation < 0.95:
        return (
            f"{file}: {place}: {name} is {slope:.3g} times the position's derivative (correlation "
            f"{correlation:.2f}): check its scale, or leave it out and have it derived",
        )
    return ()


def _without_trend(position: FloatArray, integral: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Remove means, and the linear trends too where that leaves enough of the position."""
    ramp = np.linspace(-1.0, 1.0, len(position))
    q, v = position - position.mean(), integral - integral.mean()
    trend = ramp * float(ramp @ q) / float(ramp @ ramp)
    if float(np.std(q - trend)) > 0.1 * float(np.std(q)):
        return q - trend, v - ramp * float(ramp @ v) / float(ramp @ ramp)
    return q, v
