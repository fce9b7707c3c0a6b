"""Checks whether a log is plausible for a flexible joint, one small function each."""

from collections.abc import Iterator, Mapping

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording.recording import ENCODERS, INPUTS, POSITIONS, VELOCITIES, Draft, Rank
from flexid.recording.velocities import integral, is_noise, position_noise

LARGEST_VALUE = 1e10  # in SI units; seconds since 1970 must pass
FASTEST_JOINT = 100.0  # rad/s at the link side of the gear, about 1000 rpm; m/s for a linear axis
_MISREAD = {  # by SI unit: factor if another unit was read as SI, text for a message, that unit
    "rad": (180.0 / np.pi, "in degrees and the other in radians", "deg"),
    "m": (1e3, "in millimetres and the other in metres", "mm"),
}
MOST_POWER = 2e4  # W, of the drive of a joint
_LARGEST_INPUT = {"A": 500.0, "V": 2000.0}
FEW_LEVELS = 20  # distinct values up to which an input switches between levels
_FEWEST_LEVELS, _LEAST_LEVEL = 20, 50.0  # distinct values and largest value of raw whole numbers
_SMALLEST_MOTION = 1e-12  # range over the largest value; a smaller one is rounding
_MOST_STILL = 20.0  # range over noise of a motor at rest (noise alone gives 9)
_MOST_STEPS = 3  # of an encoder, between which the position of a side at rest flickers
_MUCH_FARTHER = 20.0  # motion of the other side over those steps
_MOST_WINDING = 0.6  # rad of deflection while the motor rests; beyond it an encoder is unplugged
# Correlation of a position with the other one and its curvature, from which on they are of one
# joint: 0.998 or more in 49 releases, up to 0.92 between positions of different joints.
_COUPLED = 0.98
# Motion of the motor over the link's in phase, above which the motor seems to turn before a gear. A
# free link moves farther. Gravity or a cable as stiff as half the joint would hold it back as much.
_GEARED = 1.5
_COPIED = 0.01  # largest relative difference of a copy; the derivative of a noisy position has some
_COPY_FACTOR = 0.02  # largest deviation of a copy's factor from 1, in SI units or those of the file
_FEWEST_READINGS = 50  # changes of a sensor that are needed to estimate its reading rate
_EVENLY = 0.95  # share of the intervals between changes that are multiples of one period
_DEAD = {
    "deflection": "the link moves as if rigidly tied to the motor, or the sensor is dead",
    **dict.fromkeys(ENCODERS, "the encoder is stuck or not connected"),
    **dict.fromkeys(VELOCITIES, "the sensor is dead, so leave the column out"),
    **dict.fromkeys(INPUTS, "nothing drives the motor"),
}


def check_magnitude(log: Draft) -> None:
    """Raise if a channel, or the time, has values above `LARGEST_VALUE`."""
    for name, channel in log.channels.items():
        sizes = np.abs(channel.values)
        if np.any(sizes > LARGEST_VALUE):
            largest = f"{np.nanmax(sizes):.3g} {channel.unit}"
            raise log.refusal(name, f"{name} reaches {largest}: correct the cell or the unit")


def drop_dead_inputs(log: Draft) -> None:
    """Remove a constant input where two positions were logged: the link alone can be identified.

    Not of a joint of an arm, which has no model of its links alone.
    """
    if len(log.those_of(POSITIONS)) < 2 or log.number:
        return
    for name in log.those_of(INPUTS):
        if _is_constant(log[name], log[name]):
            log.warn(
                name,
                f"{name} is constant, so nothing drives the motor: the link was identified alone; "
                f"record an input that varies",
                Rank.SCALE,
            )
            del log.channels[name]


def check_varies(log: Draft, name: str) -> None:
    """Raise if a channel is constant over the whole log."""
    if _is_constant(log[name], log[name]):
        raise _constant_error(log, name, "constant")


def check_moves(log: Draft, name: str) -> None:
    """Raise if a position is constant except for white noise, or for a few counts."""
    size, kind = 0.0, ""
    if is_noise(log[name]):
        size, kind = np.std(log[name]), "noise"
    elif _flickers(log, name):
        size, kind = np.ptp(log[name]), "steps"
    if kind:
        what = f"constant but for {kind} of {size:.2g} {log.channels[name].unit}"
        raise _constant_error(log, name, what)


def _flickers(log: Draft, name: str) -> bool:
    """Whether a position has a few steps of its encoder only, while the other side moves far."""
    steps, extent = np.abs(np.diff(log[name])), float(np.ptp(log[name]))
    least = float(steps.min(initial=np.inf, where=steps > 0.0))
    others = [other for other in log.those_of(ENCODERS) if other != name]
    far = any(np.ptp(log[other]) > _MUCH_FARTHER * extent for other in others)
    return far and extent < (_MOST_STEPS + 0.5) * least  # steps are rounded


def is_resting(log: Draft) -> bool:
    """Whether a motor rests, as behind a brake, while the link moves by a deflection at most."""
    motor = log["motor_position"]
    if not log.channels["motor_position"].origin.columns:  # clamped, as a column map states
        return True
    still = np.ptp(motor) <= _MOST_STILL * position_noise(motor)
    return bool(still and _only_winds(log))


def _only_winds(log: Draft) -> bool:
    """Whether a link that turns moves by a deflection at most."""
    link = log.those_of(("link_position", "deflection"))[0]
    return log.joint == "revolute" and bool(np.ptp(log[link]) <= _MOST_WINDING)


def _is_constant(values: FloatArray, about: FloatArray) -> bool:
    """Whether a signal is constant up to the rounding error of the signal `about`."""
    return bool(np.ptp(values) <= _SMALLEST_MOTION * np.abs(about).max())


def _constant_error(log: Draft, name: str, what: str) -> RecordingError:
    found = f"{name} is {what} and carries no information ({_DEAD[name]})"
    reason = f"{found}: record it while it moves"
    if name in ENCODERS:
        reason += f", or, if that side is clamped, write {name}{log.number} = 0 in a column map"
    return log.refusal(name, reason)


def check_copy(log: Draft, name: str) -> None:
    """Raise if an input is the same signal as another channel, or as a position's derivative."""
    values, clock = log[name] - log[name].mean(), log.time - log.time.mean()
    total = integral(values, clock)
    for other in log.names:
        if other in INPUTS:
            continue
        # The copy may have been made in the units of the file.
        units = log.channels[name].origin.factor / log.channels[other].origin.factor
        moved = log[other] - log[other].mean()
        for copied, what in ((values, other), (total, f"the derivative of {other}")):
            matrix = np.column_stack((copied, clock, np.ones_like(clock)))
            solution = np.linalg.lstsq(matrix, moved, rcond=None)[0]
            off = float(np.std(moved - matrix @ solution))
            explained = abs(float(solution[0])) * float(np.std(copied))
            is_same = min(abs(solution[0] - 1.0), abs(solution[0] * units - 1.0)) < _COPY_FACTOR
            if off < _COPIED * explained and is_same:
                raise log.refusal(
                    (name, other),
                    f"{name} is the same signal as {what}, to {100.0 * off / explained:.1g} %: "
                    f"name the column of the input in a column map",
                )


def check_whole(log: Draft, name: str) -> None:
    """Warn of whole numbers without a unit: counts, per mille of a rating, or milliunits."""
    channel, values = log.channels[name], log[name]
    largest = float(np.abs(values).max())
    if channel.unit_stated or largest < _LEAST_LEVEL or np.any(values != np.rint(values)):
        return
    if len(np.unique(values)) >= _FEWEST_LEVELS:
        log.warn(
            name,
            f"{name} holds whole numbers only, up to {largest:.6g}, which are read as "
            f"{channel.unit}: if they are raw or in another unit, write the unit, as [mA] or "
            f"[mN m], or its scale in a column map",
            Rank.SCALE,
        )


def check_power(log: Draft, name: str) -> None:
    """Warn of a current, a voltage or a torque's power beyond the limit of a joint's drive."""
    values, unit = log[name], log.channels[name].unit
    what, most = f"is {{:.3g}} {unit}", _LARGEST_INPUT.get(unit)
    if most is None:
        speed = _speed(log, "motor_position")
        values, what, most = values[-len(speed) :] * speed, "gives {:.3g} W", MOST_POWER
    reached = float(np.quantile(np.abs(values), 0.95))
    if reached > most:
        log.warn(
            name,
            f"{name} {what.format(reached)}, more than {most:g}, the limit for a joint's drive: "
            f"check the unit, as in {name} [m{unit}]",
            Rank.SCALE,
        )


def check_speed(log: Draft, name: str) -> None:
    """Warn of a position that moves implausibly fast; raise if no unit was stated."""
    fast = float(np.quantile(np.abs(_speed(log, name)), 0.95))
    if fast <= FASTEST_JOINT:
        return
    channel = log.channels[name]
    moves = f"{name} moves at {fast:.3g} {channel.unit}/s"
    found = f"{moves}, faster than a joint does at the link side"
    if not channel.unit_stated:
        smaller = _MISREAD[channel.unit][2]
        raise log.refusal(name, f"{found}: name its unit in the header, as in {name} [{smaller}]")
    log.warn(name, f"{found}: check the unit and the {log.ratio}", Rank.SCALE)


def _speed(log: Draft, name: str) -> FloatArray:
    """Mean velocity of a position over ten samples, shape (n - 10,)."""
    time, values = log.time, log[name]
    lag = min(10, len(time) - 1)
    return (values[lag:] - values[:-lag]) / (time[lag:] - time[:-lag])


def check_repeats(log: Draft, name: str) -> None:
    """Warn of a sensor that is read at a lower rate than the log, with repeated values between."""
    steps = np.diff(log[name])
    places = np.flatnonzero(steps)
    if name in INPUTS or len(places) < _FEWEST_READINGS:
        return
    apart, sizes = np.diff(places), np.abs(steps[places])
    period = int(np.median(apart))
    # In slow motion a coarse encoder may change at even times too, but by equal steps.
    if period < 2 or np.mean(apart % period == 0) < _EVENLY or np.median(sizes) < 3.0 * sizes.min():
        return
    log.warn(
        name,
        f"{name} changes only every {period} samples, as if read at that rate and repeated: "
        f"log it as fast as the others, or all at its rate",
        Rank.DATA,
    )


def check_saturation(log: Draft, name: str) -> None:
    """Warn of a channel that is clipped: it repeatedly rests at its largest or smallest value."""
    values, limit = log[name], ": reduce the amplitude or widen the sensor's range"
    if name in INPUTS:
        limit = f" by the limit of the sensor or of the drive{limit} if it is the sensor's"
    for level, sign in ((values.min(), -1.0), (values.max(), 1.0)):
        share = np.count_nonzero(values == level) / len(values)
        # An input that switches between a few levels is not clipped.
        if share > 0.01 and len(np.unique(values)) > FEW_LEVELS and _has_limit(sign * values):
            log.warn(
                name,
                f"{name} rests at its extreme of {level:.4g} {log.channels[name].unit} in "
                f"{100.0 * share:.2g} % of the samples, as if clipped{limit}",
                Rank.DATA,
            )
            return


def _has_limit(values: FloatArray) -> bool:
    from flexid.kernels.store import load_kernel  # rarely needed

    return load_kernel("limits", (), None, ["limits"]).has_limit(values)


def check_two_encoders(log: Draft) -> None:
    """Check that link and motor position differ, and share one unit and one side of the gear.

    A joint of an arm that its drive holds moves little, and its link more than its motor.
    """
    link, motor = (log[name] for name in ENCODERS)
    correlation = float(np.corrcoef(link, motor)[0, 1])
    factor = float(motor.std() / link.std())
    larger, smaller = ("motor", "link") if factor > 1.0 else ("link", "motor")
    misread, units, _ = _MISREAD[log.channels["motor_position"].unit]
    remedy = "write the drive's gear_ratio (1 if there is none and the link is held)"
    if log.joint == "prismatic":
        remedy = "write the unit of each, and the lead of a motor that turns,"
    is_stated = log.channels["motor_position"].origin.ratio is not None
    if larger == "link":
        factor, remedy = 1.0 / factor, f"scale the link position by {factor:.3g}"
        remedy = f"correct the {log.ratio}" if is_stated else remedy
    moves = f"the {larger} position is about {factor:.3g} times the {smaller} position"
    # Near resonance one side moves several times as far, so only clear cases are refused.
    is_one_motion = abs(correlation) > _COUPLED
    may_be_geared = correlation > _COUPLED and larger == "motor" and not is_stated
    as_if = f"{moves}, as if by a gear: {remedy} in a column map"
    faults = {
        "link and motor position are the same signal, which does not show the spring: "
        "log the second encoder": _is_constant(link - motor, link),
        f"the {larger} position is about {misread:.4g} times the {smaller} position, so one is "
        f"{units}: write the unit in brackets": is_one_motion
        and abs(factor / misread - 1.0) < 0.05,
        as_if: is_one_motion and factor > 20.0 and not (is_stated and larger == "motor"),
    }
    oddities = {
        as_if: may_be_geared and factor > _GEARED,
        f"the {larger} position moves {factor:.2g} times as much as the {smaller} position: check "
        f"the {log.ratio} and the units": factor > 4.0 and not may_be_geared,
        f"link and motor position hardly follow each other (correlation {correlation:.2f}): check "
        f"that they belong to one joint, and the {log.ratio}": abs(correlation) < 0.3
        and not _are_coupled(link, motor),
    }
    for reason, is_so in faults.items():
        if is_so:
            raise log.refusal(ENCODERS, reason)
    is_held = bool(log.number) and larger == "link" and _only_winds(log)
    for odd, is_so in oddities.items():
        if is_so and not is_held:
            log.warn(ENCODERS, odd, Rank.SCALE)


def _are_coupled(link: FloatArray, motor: FloatArray) -> bool:
    """Whether one position is a sum of the other one and of its curvature, as with a spring.

    After a release the sides swing in two modes, and their correlation may be zero.
    """
    return any(_shown_by(*pair) > _COUPLED for pair in ((link, motor), (motor, link)))


def _shown_by(known: FloatArray, other: FloatArray) -> float:
    """Return the largest correlation of a position with the other one and its curvature."""
    largest, apart = 0.0, 1
    while apart < len(known) // 8:
        middle, moved = known[apart:-apart], other[apart:-apart]
        curvature = known[2 * apart :] + known[: -2 * apart] - 2.0 * middle
        both = np.column_stack((np.ones(len(middle)), middle, curvature))
        left = moved - both @ np.linalg.lstsq(both, moved)[0]
        share = 1.0 - float(np.var(left) / np.var(moved)) if np.ptp(moved) else 0.0
        largest, apart = max(largest, share), 2 * apart
    return largest**0.5


FEWEST_STILL = 20  # unchanged samples in a row that indicate a stuck sensor
_LASTING_SHARE = 0.02  # of the log, unchanged up to its end, without a jump
_JUST_AFTER = 5  # steps after a jump, with which the jump is compared
_CLEAR = 20.0  # smallest motion, in standard deviations of a position's noise
MOVED = 0.1  # of its range: smallest motion of the other side where no jump follows
_JUMP = 3.0  # size of a jump over the largest step after it, and over a step of the encoder


def drop_frozen(log: Draft) -> None:
    """Remove samples that a stuck sensor repeats, so that the log has a gap there.

    A joint that meets a stop or a brake also comes to rest within one sample. So a stretch is
    removed only if the other side moves meanwhile, and if the position has jumped when it
    changes again.
    """
    kept = np.ones(len(log.time), dtype=np.bool_)
    with np.errstate(all="ignore"):  # values are not yet checked
        clear = {name: _clear_motion(log[name]) for name in log.those_of(POSITIONS)}
        found = {name: list(_frozen_stretches(log, name, clear)) for name in clear}
    for name, stretches in found.items():
        # A side that rests to the end of the log may be held by a brake.
        lasting = [one for one in stretches if one[1] == len(kept)]
        cut = stretches[: len(stretches) - len(lasting)]
        for start, stop in cut:
            kept[start + 1 : stop] = False  # the first of the equal samples was measured
        for stuck, remedy in (
            (cut, "that part was left out; check the sensor and the logger"),
            (lasting, "check the sensor, or cut that part out"),
        ):
            if stuck:
                at = log.spans((start, stop - 1) for start, stop in stuck)
                log.warn(
                    name,
                    f"{name} does not change from {at}, while the other side moves, as if the "
                    f"sensor was stuck: {remedy}",
                    Rank.DATA,
                )
    if not kept.all():
        log.keep(kept)


def _clear_motion(values: FloatArray) -> float:
    """Return the smallest motion that is beyond noise and more than a few steps of the encoder.

    The noise of an encoder with coarse steps may come out zero.
    """
    steps = np.abs(np.diff(values))
    return max(
        _CLEAR * position_noise(values), _JUMP * steps.min(initial=np.inf, where=steps > 0.0)
    )


def _frozen_stretches(
    log: Draft, name: str, clear: Mapping[str, float]
) -> Iterator[tuple[int, int]]:
    """First sample and end of each part in which only the other side moves."""
    values = log[name]
    other = next((one for one in clear if one != name), None)
    if other is None or not np.ptp(values):
        return
    edges = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1, [len(values)]))
    for place in np.flatnonzero(np.diff(edges) >= FEWEST_STILL):
        start, stop = edges[place : place + 2].tolist()
        moves = log[other][start:stop]
        if np.ptp(moves) <= clear[other] or len(np.unique(moves)) < FEWEST_STILL // 2:
            continue
        # While a motor turns steadily, a deflection rests.
        far = np.ptp(moves) > MOVED * np.ptp(log[other]) and name != "deflection"
        lasting = stop == len(values) and stop - start >= _LASTING_SHARE * len(values)
        if _jumps(values[stop - 1 :], clear[name]) or (lasting and far):
            yield start, stop


def _jumps(values: FloatArray, clear: float) -> bool:
    """Whether a position's first step exceeds the threshold `clear` and the steps after it."""
    steps = np.abs(np.diff(values[: 2 + _JUST_AFTER]))
    return len(steps) > _JUST_AFTER and bool(steps[0] > max(clear, _JUMP * steps[1:].max()))
