"""Jumps of positions: wraps of encoders, and seams where logs were joined.

A motion is smooth from sample to sample. If all positions of a joint step much farther at one
sample than at any nearby, and stay there, another experiment begins, though the time goes on.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from flexid.arrays import FloatArray
from flexid.models.motion import JointType
from flexid.recording.recording import ENCODERS, Draft, Rank
from flexid.recording.sampling import COUNTERS, FEWEST_SAMPLES, are_gaps
from flexid.recording.velocities import position_noise

TURN = 2.0 * np.pi  # rad
_FEW_VALUES = 20  # distinct values up to which large steps are due to a coarse encoder
_LARGER = 5.0  # a jump over the largest step nearby; three lost samples make one 4 times as long
_ALSO = 2.0  # the same at a place where the other position clearly jumps
_NEARBY = 8  # changes of the position on either side; a change back among them is an outlier
_CLEAR = 20.0  # least jump over the noise: six steps of a coarse encoder
_LEAST = 0.005  # of a position's range: dry friction causes smaller jumps, which matter little
_SHORTEST_PART = 2.0  # s from jump to jump on average: with more jumps, the motion itself is rough
_SIMILAR = 2.0  # ratio of the largest of three jumps to the smallest: those of joined logs differ
_WHOLE = 1e-3  # largest deviation of a whole number of counts, or of turns
_AS_FAST = 2.0  # largest motion at an overflow over that in other samples
_SLOW = 0.125  # of a counter's range: largest motion in a sample for which overflows are clear
_SAME = 0.2  # difference of both positions' jumps over the larger one, where logs were joined


def find_seams(logs: Sequence[Draft], *, is_stream: bool) -> None:
    """Mark where all positions of a joint jump; warn of this, and of one position that jumps."""
    action = "but a stream is not cut there" if is_stream else "so the log was cut there"
    if len(logs[0].time) < FEWEST_SAMPLES:
        return
    seams: set[int] = set()
    for log in logs:
        moved = [name for name in log.those_of(ENCODERS) if np.ptp(log[name])]
        common, alone = _sorted_jumps(log, moved)
        if common:
            log.warn(
                moved,
                f"every position jumps within one sample {_by_at(log, moved, common)}, as where "
                f"logs were joined, {action}: join logs with a pause in the time, or check the "
                f"encoders",
                Rank.DATA,
            )
        for name, places in alone.items():
            log.warn(
                name,
                f"{name} jumps within one sample {_by_at(log, [name], places)}, and the other "
                f"position hardly does, as if the encoder slipped or was reset, or logs were "
                f"joined: identify the parts before and after separately",
                Rank.DATA,
            )
        seams |= common
    for log in logs:
        log.seams = np.array(sorted(seams), dtype=np.int64)


def _sorted_jumps(log: Draft, moved: Sequence[str]) -> tuple[set[int], dict[str, set[int]]]:
    """Samples after which all positions of a joint jump, and after which only one does."""
    with np.errstate(all="ignore"):  # values are not yet checked
        values = {name: _unwrapped(log, name)[0] for name in moved}
    ratios = {name: _jumps(log.time, values[name]) for name in moved}
    jumps = {
        name: {place for place, ratio in own.items() if ratio > _LARGER}
        for name, own in ratios.items()
    }
    clear = set[int]().union(*jumps.values())
    if any(_recur(np.diff(values[name])[sorted(places)]) for name, places in jumps.items()):
        return set(), {}
    common = clear.intersection(*ratios.values())
    most = (log.time[-1] - log.time[0]) / _SHORTEST_PART
    if len(clear) > max(float(bool(common)), most):  # a short log may have one seam
        return set(), {}
    far = {place for place in clear if _is_overflow(log, values, place, place in common)}
    alone = {name: places - common - far for name, places in jumps.items()}
    return common - far, {name: places for name, places in alone.items() if places}


def _recur(steps: FloatArray) -> bool:
    """Whether three jumps are of similar size, as those of a motion or of a counter."""
    sizes = np.sort(np.abs(steps))
    return bool(np.any(sizes[2:] < _SIMILAR * sizes[:-2]))


def _is_overflow(log: Draft, values: dict[str, FloatArray], place: int, together: bool) -> bool:
    """Whether one position jumps by so much that a counter may overflow, unlike the other one."""
    steps = np.array([own[place + 1] - own[place] for own in values.values()])
    ranges = np.array([np.ptp(own) for own in values.values()])
    farthest = 0.5 * (np.minimum(ranges, TURN) if log.joint == "revolute" else ranges)
    if not np.any(np.abs(steps) > farthest):
        return False
    # The spring moves both sides together where logs were joined.
    is_same = len(steps) == 2 and np.ptp(steps) < _SAME * np.abs(steps).max()
    return not (together and is_same)


def _by_at(log: Draft, names: Sequence[str], places: set[int]) -> str:
    """Largest jump of some positions after samples, and the times of the jumps, for a message."""
    before = np.array(sorted(places))
    size = max(float(np.abs(np.diff(log[name]))[before].max()) for name in names)
    return f"(by up to {size:.3g} {log.channels[names[0]].unit} at {log.at(before + 1)})"


def _jumps(time: FloatArray, values: FloatArray) -> dict[int, float]:
    """Samples after which a position's step is larger than those nearby, with the ratio."""
    with np.errstate(all="ignore"):  # values are not yet checked
        steps = np.abs(np.diff(values))
        least = max(_CLEAR * position_noise(values), _LEAST * float(np.ptp(values)))
    steps[are_gaps(time)] = 0.0
    # A sensor that is read at a lower rate than the log changes in some samples only.
    changes = np.flatnonzero(steps)
    sizes = steps[changes]
    if len(sizes) <= 2 * _NEARBY:
        return {}
    places = np.flatnonzero(sizes[_NEARBY : len(sizes) - _NEARBY] > least) + _NEARBY
    for away in (-1, 1):  # the closest changes leave few places
        places = places[sizes[places] > _ALSO * sizes[places + away]]
    nearby = sliding_window_view(np.pad(sizes, _NEARBY), 2 * _NEARBY + 1)[places].copy()
    nearby[:, _NEARBY] = 0.0
    with np.errstate(all="ignore"):
        ratios = sizes[places] / nearby.max(axis=1)
    large = ratios > _ALSO
    return dict(zip(changes[places[large]].tolist(), ratios[large].tolist(), strict=True))


def count_positions_over(log: Draft) -> None:
    """Let positions go on where counters of 16 or 32 bits overflow, unless by whole turns."""
    moving = [name for name in log.those_of(ENCODERS) if np.ptp(log[name])]
    for name, (bits, span) in product(moving, COUNTERS.items()):
        origin = log.channels[name].origin
        turns = span * abs(origin.factor) / (_motor_turn(log, name) or TURN)
        counts = (log[name] - origin.offset) / origin.factor
        is_whole = np.abs(counts - np.rint(counts)).max() < _WHOLE
        if not is_whole or np.ptp(counts) > span or abs(turns - np.rint(turns)) < _WHOLE:
            continue
        steps = np.diff(counts)
        wraps = np.rint(steps / span)
        places = np.flatnonzero(wraps)
        rest = np.abs(steps - span * wraps)
        # Where an encoder wraps by another count, it seems to move faster than elsewhere.
        usual = rest[places].max(initial=0.0) <= _AS_FAST * rest[wraps == 0.0].max(initial=0.0)
        if len(places) and usual and rest.max() < _SLOW * span:
            log.warn(
                name,
                f"{name} is a counter of {bits} bits that overflows (at {log.at(places + 1)}), so "
                f"it was counted on: check it",
            )
            log[name] = log[name] - origin.factor * span * np.cumsum(np.append(0.0, wraps))


def unwrap(log: Draft) -> str:
    """Unwrap the positions of absolute encoders, and align the two sides by whole turns.

    Return the name of the last position that was unwrapped, or an empty text.
    """
    last = ""
    for name in log.those_of(ENCODERS):
        last = name if _unwrap(log, name) else last
        _check_jumps(log, name)
    align(log, last)
    return last


def align(log: Draft, last: str) -> None:
    """Shift an unwrapped encoder by whole turns next to the other; its first turn is unknown."""
    if not last or len(log.those_of(ENCODERS)) < 2:
        return
    (other,) = {*ENCODERS} - {last}
    turn = TURN if log.joint == "revolute" else _motor_turn(log, last)
    log[last] = log[last] + turn * float(np.rint(np.median(log[other] - log[last]) / turn))


def _unwrap(log: Draft, name: str) -> bool:
    """Unwrap a position; return whether it had jumps by a turn, and raise for other jumps."""
    channel, steps = log.channels[name], np.diff(log[name])
    positions, period = _unwrapped(log, name)
    if log.joint == "prismatic" and not period:
        return False
    period = period or TURN
    # A position may change during a gap: there only a turn of the link's side is a wrap.
    seen = ~are_gaps(log.time) | (period == TURN)
    seen[log.seams] = False
    jumps = np.flatnonzero(seen & (np.abs(steps) > 0.5 * period))
    if not len(jumps) or (period == TURN and len(jumps) > len(steps) // 4):
        return False  # so many indicate a wrong unit, which `check_speed` reports
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


def _unwrapped(log: Draft, name: str) -> tuple[FloatArray, float]:
    """Unwrapped positions, and the period of the wraps on the motor's side, or 0."""
    values, turn = log[name], _motor_turn(log, name)
    large = np.abs(np.diff(values)).max() > 0.5 * (turn or TURN)
    if not large or (log.joint == "prismatic" and not turn):
        return values, 0.0
    return without_wraps(log.time, values, turn, log.joint)


def unwrapped(log: Draft, name: str) -> FloatArray:
    """Return a channel without the wraps of an encoder; `log` keeps them."""
    return _unwrapped(log, name)[0] if name in ENCODERS else log[name]


def _motor_turn(log: Draft, name: str) -> float:
    """Turn of the motor at the link's side of the gear; 0 if the encoder is at that side."""
    ratio = log.channels[name].origin.ratio
    return TURN / abs(ratio) if ratio else 0.0


def without_wraps(
    time: FloatArray,
    readings: FloatArray,
    turn: float,  # of the motor, at the link's side; 0 if the encoder is at that side
    joint: JointType = "revolute",
) -> tuple[FloatArray, float]:
    """Return the unwrapped positions, and the period of the wraps on the motor's side, or 0."""
    from flexid.kernels.store import load_kernel  # rarely needed

    kernel = load_kernel("encoder_turns", (), None, ["encoder_turns"])
    gear, positions = kernel.first_gear(), np.empty(len(readings))
    sample_time = float(np.median(np.diff(time)))
    turning = joint == "revolute"
    kernel.unwrapped_log(time, readings, turn, turning, sample_time, gear, positions)
    if gear[kernel.PERIOD] < 0.0:  # the supposed wraps were none
        return without_wraps(time, readings, 0.0, joint)
    return positions, float(gear[kernel.PERIOD])


def _check_jumps(log: Draft, name: str) -> None:
    """Warn of a position that jumps by more than half of its range, as an overflowing counter."""
    # Steps across gaps and seams, and those of coarse encoders, are no jumps.
    values = log[name]
    steps = np.where(are_gaps(log.time), 0.0, np.abs(np.diff(values)))
    steps[log.seams] = 0.0
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
