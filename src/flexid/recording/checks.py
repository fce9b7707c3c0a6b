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
MOST_POWER = 2e4  # W that the drive of a joint gives
_LARGEST_INPUT = {"A": 500.0, "V": 2000.0}
_FEWEST_LEVELS, _LEAST_LEVEL = 20, 50.0  # of whole numbers that are a drive's own unit
_SMALLEST_MOTION = 1e-12  # of the largest value
_COPIED = 0.01  # of the signal, up to which a copy differs: the derivative of a noisy position does
_SAME = 0.02  # off 1, up to which a copy's factor is, in SI units or in the file's
_FEWEST_READINGS = 50  # changes of a sensor, from which it is said how often it is read
_EVENLY = 0.95  # of the times between its changes are multiples of one
_DEAD = {
    "deflection": "the link moves as if rigidly tied to the motor, or the sensor is dead",
    "link_position": "the encoder is stuck or not connected",
    "motor_position": "the encoder is stuck or not connected",
    "link_velocity": "the sensor is dead, so leave the column out",
    "motor_velocity": "the sensor is dead, so leave the column out",
}
_DEAD_INPUT = "nothing drives the motor; without the column the link is identified alone"


def check_magnitude(file: str, name: str, channel: Channel) -> None:
    """Raise if a channel holds absurdly large values."""
    sizes = np.abs(channel.values)
    if np.any(sizes > LARGEST_VALUE):
        largest = float(np.nanmax(sizes))
        reason = f"{name} reaches {largest:.3g} {channel.unit}: correct the cell or the unit"
        raise RecordingError(file, channel.place, reason)


def _is_constant(values: FloatArray, about: FloatArray) -> bool:
    """Whether a signal is constant but for the rounding of another one."""
    return bool(np.ptp(values) <= _SMALLEST_MOTION * max(1.0, float(np.abs(about).max())))


def check_varies(file: str, name: str, channel: Channel) -> None:
    """Raise if a channel is constant over the whole log."""
    if _is_constant(channel.values, channel.values):
        raise _dead(file, name, channel, "constant")


def check_moves(file: str, name: str, channel: Channel) -> None:
    """Raise if a position is white noise about a constant."""
    if is_noise(channel.values):
        noise = f"constant but for noise of {np.std(channel.values):.2g} rad"
        raise _dead(file, name, channel, noise)


def _dead(file: str, name: str, channel: Channel, what: str) -> RecordingError:
    return RecordingError(
        file,
        channel.place,
        f"{name} is {what} and carries no information ({_DEAD.get(name, _DEAD_INPUT)}): record it "
        f"while it moves",
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


def check_whole(file: str, name: str, channel: Channel) -> tuple[str, ...]:
    """Warn of whole numbers without a unit: counts, or shares or thousandths of a drive's unit."""
    values = channel.values
    largest = float(np.abs(values).max())
    if channel.unit_stated or largest < _LEAST_LEVEL or np.any(values != np.rint(values)):
        return ()
    if len(np.unique(values)) < _FEWEST_LEVELS:
        return ()
    return (
        f"{file}: {channel.place}: {name} holds whole numbers only, up to {largest:.6g}, which are "
        f"read as {channel.unit}: if a drive or an encoder counts so, write the unit, as [mA] or "
        f"[mN m], or its scale in a column map",
    )


def check_power(
    file: str, name: str, channels: Mapping[str, Channel], time: FloatArray
) -> tuple[str, ...]:
    """Warn of an input, or of the power of a torque, that is larger than a joint's drive gives."""
    drive, motor = channels[name], channels["motor_position"]
    lag = min(10, len(time) - 1)
    values, what, most = drive.values, f"is {{:.3g}} {drive.unit}", _LARGEST_INPUT.get(drive.unit)
    if most is None:
        speed = (motor.values[lag:] - motor.values[:-lag]) / (time[lag:] - time[:-lag])
        values, what, most = drive.values[lag:] * speed, "gives {:.3g} W", MOST_POWER
    reached = float(np.quantile(np.abs(values), 0.95))
    if reached <= most:
        return ()
    return (
        f"{file}: {drive.place}: {name} {what.format(reached)}, more than {most:g}, the limit for "
        f"a joint's drive: check the unit, as in {name} [m{drive.unit}]",
    )


def check_speed(file: str, name: str, channel: Channel, time: FloatArray) -> tuple[str, ...]:
    """Warn of, or refuse where no unit was stated, a position that turns implausibly fast."""
    lag = min(10, len(time) - 1)
    changes = np.abs(channel.values[lag:] - channel.values[:-lag]) / (time[lag:] - time[:-lag])
    fast = float(np.quantile(changes, 0.95))
    if fast <= FASTEST_JOINT:
        return ()
    found = f"{name} turns at {fast:.3g} rad/s, faster than a joint does at the link side"
    if channel.unit_stated:
        return (f"{file}: {channel.place}: {found}: check the unit and the gear ratio",)
    reason = f"{found}: name its unit in the header, as in {name} [deg]"
    raise RecordingError(file, channel.place, reason)


def check_repeats(file: str, name: str, channel: Channel) -> tuple[str, ...]:
    """Warn of a sensor that is read in every so many samples only, and repeated in between.

    Where a coarse encoder changes at even times, in a slow motion, all steps are alike.
    """
    steps = np.diff(channel.values)
    places = np.flatnonzero(steps)
    if name in INPUTS or len(places) < _FEWEST_READINGS:
        return ()
    apart, sizes = np.diff(places), np.abs(steps[places])
    period = int(np.median(apart))
    if period < 2 or np.mean(apart % period == 0) < _EVENLY or np.median(sizes) < 3.0 * sizes.min():
        return ()
    return (
        f"{file}: {channel.place}: {name} changes only every {period} samples, as if it was read "
        f"so rarely and repeated: log it as fast as the others, or all at its rate",
    )


def check_saturation(file: str, name: str, channel: Channel) -> tuple[str, ...]:
    """Warn of a channel that rests at its largest or smallest value again and again.

    A sensor at its limit returns the limit exactly, much more often than the next value, and on
    several occasions; an input that is switched between few levels is no fault.
    """
    values = channel.values
    for level, sign in ((values.min(), -1.0), (values.max(), 1.0)):
        share = np.count_nonzero(values == level) / len(values)
        if share > 0.01 and len(np.unique(values)) > 20 and _has_limit(sign * values):
            return (
                f"{file}: {channel.place}: {name} stands at its extreme of {level:.4g} "
                f"{channel.unit} in {100.0 * share:.2g} % of the samples, as if clipped: reduce "
                f"the amplitude or widen the sensor's range",
            )
    return ()


def _has_limit(values: FloatArray) -> bool:
    from flexid.kernels.store import load_kernel  # few channels rest at an end

    return load_kernel("limits", (), None, ["limits"]).has_limit(values)


def check_two_encoders(file: str, link: Channel, motor: Channel) -> tuple[str, ...]:
    """Check that link and motor position are two angles at the same side of the gear.

    A joint near its resonance moves one side several times as much as the other, so that only
    clear cases are refused.
    """
    link_part, motor_part = (one.values - one.values.mean() for one in (link, motor))
    link_size, motor_size = (float(np.sqrt(np.mean(part**2))) for part in (link_part, motor_part))
    correlation = float(np.mean(link_part * motor_part)) / (link_size * motor_size)
    larger, smaller = ("motor", "link") if motor_size > link_size else ("link", "motor")
    factor = max(motor_size / link_size, link_size / motor_size)
    moves = f"the {larger} position is about {factor:.3g} times the {smaller} position"
    remedy = f"scale the link position by {1.0 / factor:.3g}"
    if larger == "motor":
        remedy = "write the drive's gear_ratio"
    is_one_motion = abs(correlation) > 0.98
    faults = {
        "link and motor position are one and the same signal, so nothing is known of the spring: "
        "log the second encoder": _is_constant(link.values - motor.values, link.values),
        f"the {larger} position is about 57.3 times the {smaller} position, so one is in degrees "
        f"and the other in radians: write the unit in brackets": (
            is_one_motion and abs(factor / DEGREES - 1.0) < 0.05
        ),
        f"{moves}, as if by a gear: {remedy} in a column map": is_one_motion and factor > 20.0,
        "link and motor position turn in opposite directions: scale one by -1 in a column map": (
            correlation < -0.98 and factor < 1.1
        ),
    }
    oddities = {
        f"the {larger} position moves {factor:.2g} times as much as the {smaller} position: check "
        f"the gear ratio and the units": factor > 4.0,
        f"link and motor position hardly follow each other (correlation {correlation:.2f}): check "
        f"that they belong to one joint, and the gear ratio": abs(correlation) < 0.3,
    }
    place = f"columns {link.column!r} and {motor.column!r}"
    for reason, is_so in faults.items():
        if is_so:
            raise RecordingError(file, place, reason)
    return tuple(f"{file}: {place}: {odd}" for odd, is_so in oddities.items() if is_so)
