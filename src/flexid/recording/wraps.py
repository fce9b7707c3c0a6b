"""Wraps of encoders: undone where they are clear, named where they are not."""

import numpy as np

from flexid.arrays import FloatArray
from flexid.models.motion import JointType
from flexid.recording.caution import Rank
from flexid.recording.channel import ENCODERS, Draft
from flexid.recording.sampling import GAP

TURN = 2.0 * np.pi  # rad
_FEW_VALUES = 20  # a position of so few counts does not jump, it steps


def unwrap(log: Draft) -> None:
    """Make the positions of absolute encoders continuous, a turn apart at most."""
    encoders = log.those_of(ENCODERS)
    wrapped = []
    for name in encoders:
        wrapped += [name] if _unwrap(log, name) else []
        _check_jumps(log, name)
    if wrapped and len(encoders) == 2:
        last = wrapped[-1]
        (other,) = {*ENCODERS} - {last}
        turn = TURN if log.joint == "revolute" else _motor_turn(log, last)
        # Where the encoders began is not known.
        log[last] = log[last] + turn * float(np.rint(np.median(log[other] - log[last]) / turn))


def _unwrap(log: Draft, name: str) -> bool:
    """Whether a position jumped by turns, which it then does no more; raise for other jumps."""
    channel, time = log.channels[name], log.time
    values, steps, clock = channel.values, np.diff(channel.values), np.diff(time)
    turn = _motor_turn(log, name)
    if np.abs(steps).max() <= 0.5 * (turn or TURN) or (log.joint == "prismatic" and not turn):
        return False
    positions, period = without_wraps(time, values, turn, log.joint)
    if log.joint == "prismatic" and not period:
        return False
    period = period or TURN
    # A position may be another after a gap: there only a turn of the link's side is a wrap.
    seen = (clock <= GAP * np.median(clock)) | (period == TURN)
    jumps = np.flatnonzero(seen & (np.abs(steps) > 0.5 * period))
    if not len(jumps) or (period == TURN and len(jumps) > len(steps) // 4):
        return False  # a wrong unit makes so many, which `check_speed` finds
    at = log.at(jumps + 1)
    if np.abs(np.diff(positions)[seen]).max() > 0.25 * period:
        raise log.refusal(
            name,
            f"{name} jumps by {abs(steps[jumps[0]]):.3g} {channel.unit} at {at}, which is not a "
            f"whole turn of an encoder: check the unit and the {log.ratio}, or remove the outlier"
            + ("" if period == TURN else "; if the encoder wraps, unwrap it, or log faster"),
        )
    log.warn(name, f"{name} jumps by a turn at {at}, and was unwrapped: check it")
    log[name] = positions
    return True


def _motor_turn(log: Draft, name: str) -> float:
    """What a turn of the motor is at the link's side; 0 where the encoder stands there."""
    ratio = log.channels[name].origin.ratio
    return TURN / abs(ratio) if ratio else 0.0


def without_wraps(
    time: FloatArray,
    readings: FloatArray,
    turn: float,  # of the motor, at the link's side; 0 where the encoder stands there
    joint: JointType = "revolute",
) -> tuple[FloatArray, float]:
    """Positions of a whole log's encoder, and what it wraps by in front of a gear, or 0."""
    from flexid.kernels.store import load_kernel  # few logs wrap

    kernel = load_kernel("encoder_turns", (), None, ["encoder_turns"])
    gear, positions = kernel.first_gear(), np.empty(len(readings))
    sample_time = float(np.median(np.diff(time)))
    turning = joint == "revolute"
    kernel.unwrapped_log(time, readings, turn, turning, sample_time, gear, positions)
    if gear[kernel.PERIOD] < 0.0:  # what looked like a wrap was none
        return without_wraps(time, readings, 0.0, joint)
    return positions, float(gear[kernel.PERIOD])


def _check_jumps(log: Draft, name: str) -> None:
    """Warn of a position that jumps across its range, as a counter does that overflows."""
    # It may be another after a gap, and one of a few counts does not jump.
    values, clock = log[name], np.diff(log.time)
    steps = np.where(clock > GAP * np.median(clock), 0.0, np.abs(np.diff(values)))
    extent = float(np.ptp(values))
    is_jump = steps > 0.5 * extent
    rest = steps[~is_jump].max(initial=0.0)
    if is_jump.any() and rest <= 0.25 * extent and len(np.unique(values)) > _FEW_VALUES:
        log.warn(
            name,
            f"{name} jumps by more than half of its range at "
            f"{log.at(np.flatnonzero(is_jump) + 1)}: if a counter overflows, unwrap it, or write "
            f"the gear_ratio in a column map; if it is an outlier, remove it",
            Rank.DATA,
        )
