"""Scales and units that the joint's own mechanics contradict.

Of the link, with what its viscous and dry friction and a late encoder add,

    link - motor = -(J link'' + g sin(link + angle)) / k + a link' + b sign(link') + c.

All of it may be smoothed alike, and then it holds for the smoothed signals: no derivative is taken
of noise. A position that has a share of its own in the deflection, beside these, has another scale
than the other position. A torque, or a deflection, that repeats with 57.3 or 2π times the angle or
with 1/57.3 of it, and not with the angle, is gravity in another unit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.recording.recording import ENCODERS, Caution, Draft, Rank, Recording
from flexid.recording.velocities import best_half_window, velocity

_REACH = 6.0  # standard deviations of the smoothing kernel on either side: 1e-8 is cut off
_FEWEST = 40  # smoothed samples that tell apart seven signals
PARTS = 10  # of the recording, each left out once, for the standard error
_DEGREES = 180.0 / np.pi
_FITS_BETTER = 0.2
"""Of the squares left over by gravity in the unit as read, those in another unit: 0.4 or more in
logs that are right, 0.1 or less in most that are wrong."""
_WRONG_UNITS = (  # factor; whether a share of the angle itself is allowed for as it is read
    (_DEGREES, False, "radians read as degrees"),
    (1.0 / _DEGREES, True, "degrees read as radians"),
    (2.0 * np.pi, True, "turns read as radians"),
)
_WIDE = 1.0  # rad of motion: in less an angle is too much like its sine
_CERTAIN = 5.0  # standard errors: 2 where a short deflection follows no mechanics at all
_EXPLAINED = 0.5
"""Of the squares of a deflection that mechanics leave, those left beside another scale: 0.8 or more
where none is wrong (0.99, at 30 standard errors, in a long log with dry friction), 0.25 or less in
most where one is by 0.6 %."""
_LATEST, _LATE_STEP = 0.25, 0.005  # s: delays of an input that are tried
_FOUND_BY_A_FIT = 0.03  # s: delays up to there are sought with the parameters
_FEWEST_REACHES = 8  # in a log whose input is tried at so large a delay to either side
_FITS_LATER = 0.25  # of what is left, at another time: 0.5 or more where an input is on time
_ON_TIME = (
    0.01  # of an input's squares, left at most: 1e-5 in steps and a real arm, 0.09 if 50 ms late
)
_SMALLEST, _LARGEST = 0.003, 0.1
"""Errors of a scale that are named: smaller ones change next to nothing; larger ones are a soft
joint, or one that is moved from outside, whose deflection the motion does not explain."""


def check_motion(log: Draft, recording: Recording, *, alone: bool) -> None:
    """Warn of scales and units of positions that the motion in a recording contradicts.

    Of a joint that is not alone, gravity along a slide varies with the angles of others.
    """
    place, wrong = log.those_of(ENCODERS), _wrong_unit(recording)
    known = alone or recording.joint == "revolute"
    share, error = scales_apart(recording) if known and not wrong else (0.0, 0.0)
    if wrong:
        log.warn(place, wrong, Rank.SCALE)
    elif share:
        ratio = "gear_ratio divided" if recording.joint == "revolute" else "lead multiplied"
        log.warn(
            place,
            f"the link moves {1.0 + share:.4f} ± {2.0 * error:.1g} times as far as the motor, "
            f"beyond what gravity and inertia bend the joint by: check the scales of both encoders "
            f"and the gear ratio (motor position times {1.0 + share:.4f}, or {ratio} by it, would "
            f"agree)",
            Rank.SCALE,
        )


def _wrong_unit(recording: Recording) -> str:
    """What to say of angles in another unit than gravity acts by; empty where there is nothing."""
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

    # What a spring or a controller makes in proportion to the angle is no gravity in degrees.
    as_read, as_spring = left(1.0, *others), left(1.0, *others, smoothed(sensed))
    for factor, beside, words in _WRONG_UNITS:
        if left(factor, *others) < _FITS_BETTER * (as_spring if beside else as_read):
            return (
                f"the load repeats with the angle, which moves by {np.ptp(sensed):.3g} rad as it "
                f"is read, as gravity does for {words}: check the unit"
            )
    return ""


def late_input(recording: Recording) -> Iterator[str]:
    """Warn of an input that acts at another time than it was logged, beyond what a fit finds."""
    late = input_lateness(recording)
    if late:
        yield Caution(
            f"{recording.source}: the input explains the motion best if it acts {abs(late):.3g} s "
            f"{'later' if late > 0.0 else 'earlier'} than it stands in the log, which is more than "
            f"a fit looks for: put all channels on one clock, or give --input-delay={late:.3g}",
            Rank.SCALE,
        )


def input_lateness(recording: Recording) -> float:
    """How much later in s than it was logged an input acts, beyond what a fit finds; else 0."""
    smoothed = smoothing(recording)
    motor, link, acts = recording.motor_position, recording.link_position, recording.input
    reach = round(_LATEST / recording.sample_time)
    if smoothed is None or link is None or acts is None or len(motor) < _FEWEST_REACHES * reach:
        return 0.0
    inside = slice(reach, len(motor) - reach)
    moved, bent = motor[inside], (link - motor)[inside]
    balance = [smoothed(moved, 2), smoothed(moved, 1), smoothed.sign(moved), smoothed(bent)]
    matrix, _ = _scaled([np.ones_like(balance[0]), *balance])
    basis = np.linalg.qr(matrix)[0]
    every = np.convolve(acts - acts.mean(), smoothed.kernels[0], mode="valid")

    def left(delay: int) -> tuple[float, float]:
        """Squares of the input that the motion does not explain, and all of it."""
        own = every[reach - delay : len(every) - reach - delay : smoothed.step]
        shares = own @ basis  # the first one is of the constant
        size = own @ own
        return float(size - shares @ shares), float(size - shares[0] ** 2)

    def share(delay: int) -> float:
        rest, moved = left(delay)
        return rest / moved if moved > 0.0 else 1.0

    step = max(1, round(_LATE_STEP / recording.sample_time))
    best = min(range(-step * (reach // step), reach + 1, step), key=share)
    best = min(range(max(best - step, -reach), min(best + step, reach)), key=share)
    # At the end of what was tried there may be less beyond: a motion that repeats itself, say.
    if not _FOUND_BY_A_FIT < abs(best) * recording.sample_time < _LATEST - 2.0 * _LATE_STEP:
        return 0.0
    most = int(_FOUND_BY_A_FIT / recording.sample_time)
    found = range(-most, most + 1)
    # What a step or few turns of a square wave leave may be rounding, at any time.
    if min(left(delay)[0] for delay in found) <= _ON_TIME * left(best)[1]:
        return 0.0
    is_clear = share(best) < _FITS_LATER * min(map(share, found))
    return best * recording.sample_time if is_clear else 0.0


def scales_apart(recording: Recording) -> tuple[float, float]:
    """By how much more the link moves than the motor than mechanics allow, and its error; or 0."""
    smoothed = smoothing(recording)
    motor, link = recording.motor_position, recording.link_position
    turns = recording.joint == "revolute"
    if smoothed is None or link is None or (turns and np.ptp(motor) <= _WIDE):
        return 0.0, 0.0
    gravity = [smoothed(np.sin(link)), smoothed(np.cos(link))] if turns else []
    mechanics = [*gravity, smoothed(link, 2), smoothed(link, 1), smoothed.sign(link)]
    deflection, moved = smoothed(link - motor), smoothed(motor)
    share, error = own_share(deflection, moved, mechanics)
    left, beside = left_over(deflection, mechanics), left_over(deflection, [moved, *mechanics])
    named = _SMALLEST < abs(share) < _LARGEST and abs(share) > _CERTAIN * error
    return (share, error) if named and beside < _EXPLAINED * left else (0.0, 0.0)


@lru_cache(maxsize=1)  # directions, scales and a late input are asked of the same one
def smoothing(recording: Recording) -> Smoothing | None:
    """What smooths the noise of both encoders; None where a recording is too short for it."""
    motor, link = recording.motor_position, recording.link_position
    sensed = motor if link is None else link
    width = max(map(best_half_window, [motor] if link is None else [motor, link]))
    smoothed = Smoothing(width, recording.sample_time)
    enough = len(motor) - smoothed.length >= _FEWEST * width and np.ptp(sensed) > 0.0
    return smoothed if enough else None


class Smoothing:
    """A Gaussian kernel with its derivatives, at every so many samples as it makes much alike."""

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
        """Smoothed sign of a position's velocity."""
        return self(np.sign(velocity(position, self._time, self.step)))


def left_over(target: FloatArray, *signals: Sequence[FloatArray]) -> float:
    """Squares of a signal that others and a constant leave unexplained."""
    matrix, _ = _scaled([np.ones_like(target), *chain(*signals)])
    solution = np.linalg.lstsq(matrix, target, rcond=1e-10)[0]
    return float(np.sum((target - matrix @ solution) ** 2))


def own_share(
    target: FloatArray, regressor: FloatArray, others: Sequence[FloatArray]
) -> tuple[float, float]:
    """A regressor's own share in a target, beside others, and its standard error (jackknife)."""
    matrix, sizes = _scaled([regressor, *others, np.ones_like(regressor)])

    def share(left_out: NDArray[np.intp]) -> float:
        kept = np.ones(len(target), dtype=np.bool_)
        kept[left_out] = False
        return float(np.linalg.lstsq(matrix[kept], target[kept], rcond=1e-10)[0][0] / sizes[0])

    without = [share(part) for part in np.array_split(np.arange(len(target)), PARTS)]
    return float(np.mean(without)), float(np.std(without) * np.sqrt(PARTS - 1.0))


def _scaled(signals: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Signals as columns of one size, and their sizes."""
    matrix = np.column_stack(signals)
    sizes = np.linalg.norm(matrix, axis=0)
    sizes[sizes == 0.0] = 1.0
    return matrix / sizes, sizes
