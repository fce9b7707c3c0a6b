"""Detection of scales, units and signs that the mechanics of the joint contradict.

With viscous and dry friction, a damped spring and a late encoder, the mechanics are

    link - motor     = -(J link'' + g sin(link + angle)) / k + a link' + b sign(link') + c
                       + d motor',
    torque           =  (J + M) motor'' + J (link - motor)'' + g sin(link + angle) + friction.

The equations also apply to signals that are all smoothed by one kernel, so no noise has to be
differentiated. If the deflection also contains a share of the motor position itself, the two
encoders differ in scale. If gravity fits a torque, or a deflection, with 57.3, 1/57.3 or 2π times
the angle instead of the angle, the unit of the angle is wrong. A deflection opposes the link's
acceleration, and a torque has the sign of the motor's: if a log shows the opposite, a sign is
wrong, since stiffness and inertia are positive, and a drive cannot return more energy than it
received. If the motor moves like a link and the input drives the other side, both are exchanged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.recording.recording import ENCODERS, INPUTS, Caution, Draft, Rank, Recording
from flexid.recording.velocities import best_half_window, velocity

_REACH = 6.0  # half length of the smoothing kernel in standard deviations: truncated at 1e-8
_FEWEST = 40  # smoothed samples that separate seven signals
PARTS = 10  # parts of the recording for the jackknife, each left out once
_DEGREES = 180.0 / np.pi
_FITS_BETTER = 0.2
"""Residual squares with another unit over those with the unit as read: 0.4 or more in correct
logs, 0.1 or less in most wrong ones."""
_WRONG_UNITS = (  # factor; whether the unit as read is tested with a spring term as well
    (_DEGREES, False, "radians read as degrees"),
    (1.0 / _DEGREES, True, "degrees read as radians"),
    (2.0 * np.pi, True, "turns read as radians"),
)
_WIDE = 1.0  # rad of motion: in smaller motions an angle resembles its sine
_CERTAIN = 5.0  # standard errors
_EXPLAINED = 0.5
"""Residual squares of a deflection with another scale over those without: 0.8 or more in correct
logs (0.99, at 30 standard errors, in a long log with dry friction), 0.25 or less in most logs with
an error of 0.6 %."""
_LATEST, _LATE_STEP = 0.25, 0.005  # s: delays of an input that are tried
_LATEST_OF_FIT = 0.03  # s, the largest delay that is estimated with the parameters
_FEWEST_REACHES = 8  # least length of a log over the largest delay that is tried
_FITS_LATER = 0.25  # residual squares with a delay over those without: 0.5 or more in correct logs
_ON_TIME = 0.01  # residual squares over the input's: 1e-5 in logs of steps, 0.09 if 50 ms late
# Residual squares of an input that the spring explains over the input's, and with friction and
# inertia of the motor over those without. Sensors at a joint gave 1e-4 or less, and 0.95 or more;
# of 315 inputs of motors, those with less than 0.05 gave 0.08 or less.
_OF_THE_SPRING, _AS_MUCH = 0.05, 0.5
_SMALLEST = 0.003  # scale error: a smaller one hardly changes an estimate
_LEAST = -0.1
"""Scale error that may be none: a link that rests behind a soft spring has -1, and one that
something else moves faster than the motor, by the square of the rates, up to 0."""


def check_motion(log: Draft, recording: Recording, *, alone: bool) -> None:
    """Warn of scales and units of positions that the motion of a recording contradicts.

    The scales of a prismatic joint are tested only if it is `alone`: in an arm, gravity along it
    varies with the angles of other joints.
    """
    place, wrong = log.those_of(ENCODERS), _wrong_unit(recording) or _wrong_deflection(recording)
    known = alone or recording.joint == "revolute"
    share, error = scales_apart(recording) if known and not wrong else (0.0, 0.0)
    if wrong:
        log.warn(place, wrong, Rank.SCALE)
    elif alone and _are_exchanged(recording):
        log.warn(
            place,
            "the input seems to drive link_position, which moves motor_position through the "
            "spring: exchange both columns",
            Rank.SCALE,
        )
    elif share:
        unless = "unless a spring holds the link back, " if share < 0.0 else ""
        ratio = "gear_ratio divided" if recording.joint == "revolute" else "lead multiplied"
        log.warn(
            place,
            f"the link moves {1.0 + share:.4f} ± {2.0 * error:.1g} times as far as the motor, "
            f"which gravity and inertia do not explain: {unless}check the scales of both encoders "
            f"and the gear ratio (motor position times {1.0 + share:.4f}, or {ratio} by it, would "
            f"agree)",
            Rank.SCALE,
        )


def _wrong_unit(recording: Recording) -> str:
    """Text of a warning if gravity shows that angles are in another unit; else empty."""
    smoothed = smoothing(recording)
    if smoothed is None or recording.joint == "prismatic":
        return ""
    motor, link = recording.motor_position, recording.link_position
    sensed = motor if link is None else link
    acts = recording.input
    moved = smoothed(recording.deflection if acts is None else acts)
    others = [smoothed(sensed, 2), smoothed(motor, 2), smoothed(motor, 1), smoothed.sign(motor)]

    def left(factor: float, *more: FloatArray) -> float:
        angle = factor * sensed
        return left_over(moved, [smoothed(np.sin(angle)), smoothed(np.cos(angle))], more)

    # A spring or a controller proportional to the angle must not be mistaken for gravity.
    as_read, as_spring = left(1.0, *others), left(1.0, *others, smoothed(sensed))
    for factor, with_spring, words in _WRONG_UNITS:
        if left(factor, *others) < _FITS_BETTER * (as_spring if with_spring else as_read):
            return (
                f"the angle moves by {np.ptp(sensed):.3g} rad as read, but gravity shows "
                f"{words}: check the unit"
            )
    return ""


def _wrong_deflection(recording: Recording) -> str:
    """Text of a warning if the link moves as if its deflection were in degrees; else empty."""
    smoothed = smoothing(recording)
    if smoothed is None or not recording.link_from_deflection or recording.joint == "prismatic":
        return ""
    bent, motor = recording.deflection, recording.motor_position

    def left(factor: float) -> float:
        link = motor + factor * bent
        own = [smoothed(link, 2), *_resistance(recording, smoothed, link)]
        return left_over(smoothed(bent), own)

    # Its sign may be wrong, too, which shows only in the right unit.
    if min(left(1.0 / _DEGREES), left(-1.0 / _DEGREES)) < _FITS_BETTER * min(left(1.0), left(-1.0)):
        return (
            f"the deflection moves by {np.ptp(bent):.3g} rad as read, but the link as if these "
            f"were degrees: check the unit of the deflection"
        )
    return ""


def _are_exchanged(recording: Recording) -> bool:
    """Whether the motor follows the mechanics of a link, and the link those of a driven motor."""
    smoothed = smoothing(recording)
    motor, link, acts = recording.motor_position, recording.link_position, recording.input
    if smoothed is None or link is None or acts is None or recording.clamped:
        return False
    if recording.link_from_deflection or _work_share(acts, link) <= 0.0:
        return False  # what drives a side does work on it, unlike a controller that holds it
    bent = smoothed(link - motor)
    (is_right, rest), (is_other_right, other_rest) = (
        _opposes(sign * bent, smoothed(side, 2), _resistance(recording, smoothed, side))
        for sign, side in ((1.0, link), (-1.0, motor))
    )
    if not is_other_right or (is_right and other_rest > _BETTER_FIT * rest):
        return False

    # A pushed link also moves a motor through the spring. But the input, which may follow the
    # spring's torque, then explains the motor's balance better.
    def left(side: FloatArray) -> tuple[float, float]:
        own = [smoothed(side, 2), *_resistance(recording, smoothed, side)]
        return left_over(bent, own, [smoothed(acts)]), left_over(bent, own)

    (with_input, without), (motor_with_input, motor_without) = map(left, (link, motor))
    return with_input * motor_without < _BETTER_FIT * motor_with_input * without


def is_of_the_spring(recording: Recording) -> bool:
    """Whether the input is the spring's torque, in which the motor does not show."""
    smoothed = smoothing(recording)
    motor, link, acts = recording.motor_position, recording.link_position, recording.input
    if smoothed is None or link is None or acts is None or recording.clamped:
        return False
    torque, bent = smoothed(acts), motor - link
    spring = [smoothed(bent), smoothed(bent**3)]  # which may harden
    of_motor = [smoothed(motor, 2), *_resistance(recording, smoothed, motor)]
    whole, left = left_over(torque), left_over(torque, spring)
    return left < _OF_THE_SPRING * whole and left_over(torque, spring, of_motor) > _AS_MUCH * left


def late_input(recording: Recording) -> Iterator[str]:
    """Yield a warning if an input acts earlier or later than logged by more than a fit searches."""
    smoothed = smoothing(recording)
    motor, link, acts = recording.motor_position, recording.link_position, recording.input
    reach = round(_LATEST / recording.sample_time)
    if smoothed is None or link is None or acts is None or len(motor) < _FEWEST_REACHES * reach:
        return
    inside = slice(reach, len(motor) - reach)
    moved, bent = motor[inside], (link - motor)[inside]
    balance = [smoothed(moved, 2), smoothed(moved, 1), smoothed.sign(moved), smoothed(bent)]
    matrix, _ = _scaled([np.ones_like(balance[0]), *balance])
    basis = np.linalg.qr(matrix)[0]
    every = np.convolve(acts - acts.mean(), smoothed.kernels[0], mode="valid")

    def left(delay: int) -> tuple[float, float]:
        """Squares of the input that the motion does not explain, and of the input."""
        own = every[reach - delay : len(every) - reach - delay : smoothed.step]
        shares = own @ basis  # the first one belongs to the constant
        size = own @ own
        return float(size - shares @ shares), float(size - shares[0] ** 2)

    def share(delay: int) -> float:
        rest, moved = left(delay)
        return rest / moved if moved > 0.0 else 1.0

    step = max(1, round(_LATE_STEP / recording.sample_time))
    best = min(range(-step * (reach // step), reach + 1, step), key=share)
    best = min(range(max(best - step, -reach), min(best + step, reach)), key=share)
    late = best * recording.sample_time
    # A minimum at the end of the range may continue beyond it, as for a periodic motion.
    if not _LATEST_OF_FIT < abs(late) < _LATEST - 2.0 * _LATE_STEP:
        return
    most = int(_LATEST_OF_FIT / recording.sample_time)
    found = range(-most, most + 1)
    # For a step or a square wave the residual may be rounding at any delay.
    if min(left(delay)[0] for delay in found) <= _ON_TIME * left(best)[1]:
        return
    if share(best) < _FITS_LATER * min(map(share, found)):
        yield Caution(
            f"{recording.source}: the input explains the motion best if it acts {abs(late):.3g} s "
            f"{'later' if late > 0.0 else 'earlier'} than logged, which is more than "
            f"the fit searches: put all channels on one clock, or give --input-delay={late:.3g}",
            Rank.SCALE,
        )


def scales_apart(recording: Recording) -> tuple[float, float]:
    """Return the scale error of link to motor and its standard error; 0 if none is clear."""
    smoothed = smoothing(recording)
    motor, link = recording.motor_position, recording.link_position
    turns = recording.joint == "revolute"
    if smoothed is None or link is None or (turns and np.ptp(motor) <= _WIDE):
        return 0.0, 0.0
    gravity = [smoothed(np.sin(link)), smoothed(np.cos(link))] if turns else []
    mechanics = [*gravity, smoothed(link, 2), smoothed(link, 1), smoothed.sign(link)]
    deflection, moved = smoothed(link - motor), smoothed(motor)
    found = _clear_share(deflection, moved, mechanics)
    # With the link's velocity, the motor's is damping of the spring, which may look like a scale.
    damped = found and _clear_share(deflection, moved, [*mechanics, smoothed(motor, 1)])
    return found if found and damped else (0.0, 0.0)


def _clear_share(
    deflection: FloatArray, moved: FloatArray, mechanics: Sequence[FloatArray]
) -> tuple[float, float] | None:
    """Return the motor's share in a deflection and its standard error; None if it is not clear."""
    share, error = own_share(deflection, moved, mechanics)
    left = left_over(deflection, mechanics)
    scaled = left_over(deflection, [moved, *mechanics])
    named = abs(share) > max(_SMALLEST, _CERTAIN * error) and share > _LEAST
    return (share, error) if named and scaled < _EXPLAINED * left else None


@lru_cache(maxsize=1)  # several checks smooth the same recording
def smoothing(recording: Recording) -> Smoothing | None:
    """Return a smoothing wide enough for the noise of both encoders; None for a short recording."""
    motor, link = recording.motor_position, recording.link_position
    sensed = motor if link is None else link
    width = max(map(best_half_window, [motor] if link is None else [motor, link]))
    smoothed = Smoothing(width, recording.sample_time)
    enough = len(motor) - smoothed.length >= _FEWEST * width and np.ptp(sensed) > 0.0
    return smoothed if enough else None


class Smoothing:
    """Gaussian smoothing and derivatives, evaluated once per width of the kernel."""

    def __init__(self, width: int, sample_time: float) -> None:
        reach = int(_REACH * width) + 1
        at = np.arange(-reach, reach + 1) / width
        bell = np.exp(-0.5 * at**2)
        bell /= bell.sum()
        span = width * sample_time
        self.kernels = bell, at * bell / span, (at**2 - 1.0) * bell / span**2
        self.length = 2 * reach
        self.step = width
        self._time = sample_time

    def __call__(self, values: FloatArray, derivative: int = 0) -> FloatArray:
        """Return smoothed values, or their first or second derivative, shape (m,)."""
        windows = np.lib.stride_tricks.sliding_window_view(values, self.length + 1)
        return windows[:: self.step] @ self.kernels[derivative]

    def sign(self, position: FloatArray) -> FloatArray:
        """Return the smoothed sign of a position's velocity."""
        return self(np.sign(velocity(position, self._time, self.step)))


def left_over(target: FloatArray, *signals: Sequence[FloatArray]) -> float:
    """Return the residual squares of a least-squares fit of a signal by others and a constant."""
    matrix, _ = _scaled([np.ones_like(target), *chain(*signals)])
    solution = np.linalg.lstsq(matrix, target, rcond=1e-10)[0]
    return float(np.sum((target - matrix @ solution) ** 2))


def own_share(
    target: FloatArray, regressor: FloatArray, others: Sequence[FloatArray]
) -> tuple[float, float]:
    """Return the coefficient of a regressor among others, and its jackknife standard error."""
    matrix, sizes = _scaled([regressor, *others, np.ones_like(regressor)])

    def share(left_out: NDArray[np.intp]) -> float:
        kept = np.ones(len(target), dtype=np.bool_)
        kept[left_out] = False
        return float(np.linalg.lstsq(matrix[kept], target[kept], rcond=1e-10)[0][0] / sizes[0])

    without = [share(part) for part in np.array_split(np.arange(len(target)), PARTS)]
    return float(np.mean(without)), float(np.std(without) * np.sqrt(PARTS - 1.0))


def _scaled(signals: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Signals as columns of unit norm, and their norms."""
    matrix = np.column_stack(signals)
    sizes = np.linalg.norm(matrix, axis=0)
    sizes[sizes == 0.0] = 1.0
    return matrix / sizes, sizes


_OPPOSITE = -0.98  # correlation of link and motor of about the same amplitude
_SIZE_RATIO = 1.1  # of link and motor: a soft joint near its resonance moves one side more
_DISSIPATED = 0.02  # friction's least share of the absolute work: more in 54 of 56 trials
_MOST_LEFT = 0.5  # largest residual over the signal, as squares, of a deflection or an input
# Residual after over before a change of sign, at most 0.33 if it is needed, or of sides, or with
# the input. No sides of 115 correct logs seem exchanged; of as many exchanged ones, 107 do.
_BETTER_FIT = 0.5


def correct_signs(log: Draft, recording: Recording, *, alone: bool) -> list[str]:
    """Change the sign of a channel that has the wrong one, with a warning; return its name.

    Its velocity is changed as well if that agrees with it. An input is tested only if the joint is
    `alone`: inputs of an arm also move other joints.
    """
    if _is_reversed_link(recording):
        name, why = "link_position", "it moves against the motor's position"
    elif recording.link_from_deflection and _fits_turned(
        recording, recording.motor_position - recording.deflection
    ):
        name, why = "deflection", "by the link's acceleration it is motor minus link position"
    elif alone and _is_reversed_input(recording):
        name = next(name for name in INPUTS if name in log.channels)
        why = "it acts against the motor's acceleration"
    else:
        return []
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
    for changed in names:
        channel = log.channels[changed]
        factor, offset = -channel.origin.factor, 0.0 - channel.origin.offset
        origin = replace(channel.origin, factor=factor, offset=offset)
        log.channels[changed] = replace(channel, values=-channel.values, origin=origin)
    return names


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


def _fits_turned(recording: Recording, turned_link: FloatArray, *, otherwise: bool = False) -> bool:
    """Whether the turned link fits the mechanics better; `otherwise` if neither sign fits."""
    smoothed = smoothing(recording)
    if smoothed is None:
        return otherwise
    (is_right, left), (is_other_right, left_other) = (
        _opposes(
            smoothed(link - recording.motor_position),
            smoothed(link, 2),
            _resistance(recording, smoothed, link),
        )
        for link in (recording.needed_link_position, turned_link)
    )
    if not is_other_right:
        return otherwise and not is_right
    return not is_right or left_other < _BETTER_FIT * left


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
    if _work_share(recording.input, motor) >= -_DISSIPATED:
        return False
    return _opposes(smoothed(recording.input), smoothed(motor, 2), others)[0]


def _work_share(acts: FloatArray, position: FloatArray) -> float:
    """Return the work of an input at a position over its absolute work; 0 if there is none."""
    work = 0.5 * (acts[1:] + acts[:-1]) * np.diff(position)
    return float(work.sum() / (np.abs(work).sum() or 1.0))


def _opposes(
    signal: FloatArray, acceleration: FloatArray, others: Sequence[FloatArray]
) -> tuple[bool, float]:
    """Whether a signal clearly opposes the acceleration, and the share that is left unexplained."""
    share, error = own_share(signal, acceleration, others)
    size = left_over(signal)
    left = left_over(signal, [acceleration, *others]) / size if size else 1.0
    # Fewer samples are overfitted, and the jackknife then underestimates the error.
    is_enough = len(signal) >= PARTS * (len(others) + 2)
    return bool(is_enough and left < _MOST_LEFT and share < -_CERTAIN * error), left


def _resistance(recording: Recording, smoothed: Smoothing, moved: FloatArray) -> list[FloatArray]:
    """Regressors of gravity (of a linear axis: of a spring load) and of one side's friction."""
    turns = recording.joint == "revolute"
    load = [smoothed(np.sin(moved)), smoothed(np.cos(moved))] if turns else [smoothed(moved)]
    return [*load, smoothed(moved, 1), smoothed.sign(moved)]
