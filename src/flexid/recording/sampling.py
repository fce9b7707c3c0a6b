"""From time stamps to an even grid: gaps separate recordings, jitter is interpolated."""

from collections.abc import Sequence
from functools import reduce
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import RecordingError, SettingError
from flexid.recording.recording import (
    LONGEST_SAMPLE_TIME,
    POSITIONS,
    SHORTEST_SAMPLE_TIME,
    Draft,
    Rank,
)
from flexid.recording.roughness import are_smoother_at
from flexid.recording.table import Table, is_stamp

FEWEST_SAMPLES = 20  # of a recording
FEWEST_TO_IDENTIFY = 75  # of a recording: 50 to fit, and a third of held-out data
GAP = 1.5  # sample times in a step; a single lost sample makes it 2
WIDE_GAP = 4.0  # the same where steps vary: interpolation bridges up to three lost samples
MOST_GAPS = 0.05  # share of the steps
EVEN = 1e-3  # of a sample time: deviation by rounding of printed times
MOST_JITTER = 0.1  # of a sample time, up to which steps show gaps and lost samples
_OF_STAMPS = (
    "; if a clock was set back, as to winter time, log UTC; times of day must be less than 12 h "
    "apart, so write the date too; and write all zeros after the point"
)
ROUNDED = 1.05  # range of the rounding error in last digits: 1, and the error of the fitted line
_NEAR_FIRST = 0.1  # of the shortest part: distance from the first time at which the time restarts
_PAUSE = 10.0  # sample times between the end of a part and a restart of the time
COUNTERS = {16: 2.0**16, 32: 2.0**32}  # range in ticks, by the bits of a counter
_TICKS = (1e-3, 1e-6)  # s, of a counter whose times are written in s
_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # in s
_SLOW = 0.05  # s, of a sample time that may be in another unit: 0.1 ms read as s are 0.1 s
_MOST_PER_DIGIT = 4.0  # samples with the same time; with more the line is too uncertain


class Grid(NamedTuple):
    """Even time grid of a log, and the samples of its recordings."""

    sample_time: float  # common to all recordings, in s
    recordings: tuple[slice, ...]  # the samples of each
    resample: bool = False  # whether stamps deviate from the even grid by more than rounding


def count_time_over(log: Draft) -> None:
    """Let the time of a counter that overflows go on, with a warning."""
    steps = np.diff(log.time)
    falls = np.flatnonzero(steps < 0.0)
    ticks = dict.fromkeys((log.channels["time"].origin.factor, *_TICKS))
    for bits, tick in product(COUNTERS, ticks) if len(falls) else ():
        span = COUNTERS[bits] * tick
        passed = steps[falls] + span
        if np.all((passed > 0.0) & (passed < WIDE_GAP * np.median(steps))):
            log.warn(
                "time",
                f"it is a counter of {bits} bits that overflows (after {log.at(falls)}), so it was "
                f"counted on: log it with {2 * bits} bits",
            )
            log["time"] = log.time + span * np.cumsum(np.append(False, steps < 0.0))
            return


def count_on(log: Draft) -> None:
    """Let the time go on after a pause where it restarts near its first value, with a warning."""
    time, steps = log.time, np.diff(log.time)
    parts = parts_between(steps < 0.0)
    first, *others = parts
    if not others or min(part.stop - part.start for part in parts) < FEWEST_SAMPLES:
        return
    spans = [float(time[part.stop - 1] - time[part.start]) for part in parts]
    is_near = all(abs(time[part.start] - time[0]) < _NEAR_FIRST * min(spans) for part in others)
    if not is_near or any(_are_same(log, first, part) for part in others):
        return
    ends = np.array([part.start - 1 for part in others])
    log.warn(
        "time",
        f"it restarts after {log.at(ends)}, so the log was cut there into {len(parts)} "
        f"recordings: write a file for each, or a time that goes on",
        Rank.DATA,
    )
    pause = _PAUSE * float(np.median(steps))
    back = np.zeros(len(time))
    back[ends + 1] = pause - steps[ends]
    log["time"] = time + np.cumsum(back)
    log.restarts = tuple(log.time[ends].tolist())


def _are_same(log: Draft, one: slice, other: slice) -> bool:
    """Whether two parts of a log are equal, as in a log that was written twice."""
    values = (log[name] for name in log.names)
    return all(np.array_equal(own[one], own[other], equal_nan=True) for own in values)


def drop_repeats(log: Draft, table: Table) -> None:
    """Remove rows that are written twice; raise at the first row whose time does not increase."""
    time = log.time
    steps = np.diff(time)
    again = steps == 0.0
    if np.all(steps > 0.0):
        return
    for name in log.names:
        values = log[name]
        again &= (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
    increases = (steps > 0.0) | again
    if not np.all(increases):  # at 2000 samples per second in whole ms, two have the same time
        sample_time = _rounded_step(log)
        if sample_time is None:
            raise _order_error(log, table, increases)
        log["time"] = time[0] + sample_time * np.arange(len(time))
        return
    log.warn(
        "",
        f"rows written twice (at {log.at(np.flatnonzero(again) + 1)}; {np.count_nonzero(again)} in "
        f"all) were taken once: log every sample once",
        Rank.DATA,
    )
    log.keep(np.concatenate(([True], ~again)))


def _order_error(log: Draft, table: Table, is_next: NDArray[np.bool_]) -> RecordingError:
    """Error for the first row whose time does not increase."""
    time, column = log.time, log.channels["time"].column
    index = int(np.argmax(~is_next)) + 1
    cell = table.frame[column][index] if column in table.names else 0.0
    is_stamped = not isinstance(cell, int | float) and is_stamp(str(cell))
    is_back = time[index] < time[index - 1]
    forward = np.diff(time)[np.diff(time) > 0.0]
    # The cause may be a wrong unit of the time, but half the steps of unsorted rows run back.
    if not is_stamped and len(forward) > 0.75 * len(time):
        check_typical(log.file, log.channels["time"].place, float(np.median(forward)), forward)
    before, now = f"{time[index - 1]:.9g}", f"{time[index]:.9g}"
    restarts = abs(time[index] - time[0]) < _NEAR_FIRST * (time[index - 1] - time[0])
    sort = "" if restarts else "sort the rows, or "  # which would mix two runs
    reason = (
        f"time runs backwards (from {before} s to {now} s): {sort}cut the file there into two logs"
        if is_back
        else f"time repeats ({now} s): remove the repeated row, or write the time with more digits"
    )
    reason += _OF_STAMPS if is_stamped and is_back else ""
    return RecordingError(table.file, table.place(index, column), reason)


def keep_common(logs: Sequence[Draft]) -> None:
    """Remove samples that one joint's log lacks from the logs of all joints."""
    common = reduce(np.intersect1d, (log.time for log in logs))
    if len(common) < FEWEST_SAMPLES <= min(len(log.time) for log in logs):
        raise logs[0].refusal(
            "",
            f"the joints have {len(common)} samples at the same time, but at "
            f"least {FEWEST_SAMPLES} are needed: log all joints in every sample, on one clock",
        )
    for log in logs:
        if len(log.time) > len(common):
            log.keep(np.isin(log.time, common))


def are_gaps(time: FloatArray) -> NDArray[np.bool_]:
    """Return whether samples are missing after each of increasing times, shape (n - 1,)."""
    steps = np.diff(time)
    return steps > GAP * np.median(steps)


def parts_between(are_ends: NDArray[np.bool_]) -> list[slice]:
    """Return the parts between cuts; `are_ends` marks the samples before a cut, shape (n - 1,)."""
    cuts = [0, *(np.flatnonzero(are_ends) + 1).tolist(), len(are_ends) + 1]
    return [slice(first, stop) for first, stop in pairwise(cuts)]


def even_grid(logs: Sequence[Draft]) -> Grid:
    """Return the even grid of increasing time stamps in s; raise if they are too uneven.

    The joints of an arm share one clock, so the log of the first joint is used.
    """
    log = logs[0]
    time = log.time
    if len(time) < FEWEST_SAMPLES:
        found = "is 1 sample" if len(time) == 1 else f"are {len(time)} samples"
        raise log.refusal(
            "",
            f"there {found}, but at least {FEWEST_SAMPLES} are needed to read a log, and "
            f"{FEWEST_TO_IDENTIFY} to identify it: record for longer",
        )
    steps = np.diff(time)
    typical = float(np.median(steps))
    check_typical(log.file, log.channels["time"].place, typical, steps)
    if typical > _SLOW and not log.channels["time"].unit_stated:
        log.warn(
            "time",
            f"it is read as seconds, so the steps are {typical:.3g} s, longer than usual for a "
            f"drive: if it is in another unit, write that unit, as in [ms]",
            Rank.SCALE,
        )
    is_gap = are_gaps(time)
    off_whole = np.abs(steps / typical - np.rint(steps / typical)).max()
    is_whole = off_whole < EVEN and is_gap.mean() <= MOST_GAPS  # where samples are missing
    rounded = None if is_whole else _rounded_step(log)
    if rounded is not None:
        return Grid(rounded, _recordings(log, np.zeros_like(is_gap)))
    if is_gap.mean() > MOST_GAPS or _jitter(steps[~is_gap]) > MOST_JITTER:
        usual = steps[steps <= WIDE_GAP * typical].mean()
        is_gap = steps > WIDE_GAP * usual
        if is_gap.mean() > MOST_GAPS or len(_changes(steps)) == 1:
            raise _uneven_error(log, steps)
    recordings = _recordings(log, is_gap)
    sample_time = _fitted_sample_time(time, recordings)
    apart = (time[one] - sample_time * np.arange(one.stop - one.start) for one in recordings)
    if max(np.abs(off - np.median(off)).max() for off in apart) / sample_time <= EVEN:
        return Grid(sample_time, recordings)
    is_even = _is_smoother_if_even(logs, recordings)
    within = np.concatenate([np.diff(time[recording]) for recording in recordings])
    taken = (
        "the positions are smoother at even times, so these were taken"
        if is_even
        else "so the channels were interpolated to even times"
    )
    warn_uneven(log, 200.0 * _jitter(within), sample_time, taken)
    return Grid(sample_time, recordings, resample=not is_even)


def warn_uneven(log: Draft, percent: float, sample_time: float, taken: str) -> None:
    """Warn of steps that vary by some percent of the sample time, in s, and of what was taken."""
    log.warn(
        "time",
        f"the time steps vary by {percent:.2g} % of the sample time of {sample_time * 1e3:.6g} ms, "
        f"{taken}: record at a fixed rate, or write the time with more digits",
    )


def _recordings(log: Draft, is_gap: NDArray[np.bool_]) -> tuple[slice, ...]:
    """Parts between gaps and seams that are long enough; warn of the gaps, and of other parts."""
    is_cut = is_gap.copy()
    is_cut[log.seams] = True
    parts = parts_between(is_cut)
    recordings = [part for part in parts if part.stop - part.start >= FEWEST_SAMPLES]
    if not recordings:
        reason = f"gaps leave no {FEWEST_SAMPLES} samples in a row: record without gaps"
        raise log.refusal("time", reason)
    _warn_of_gaps(log, is_gap, parts, recordings)
    return tuple(recordings)


def _jitter(steps: FloatArray) -> float:
    """Half of the largest relative deviation of a step, since two time stamps cause it."""
    return float(np.abs(steps / steps.mean() - 1.0).max()) / 2.0


def _is_smoother_if_even(logs: Sequence[Draft], recordings: Sequence[slice]) -> bool:
    """Whether samples were even but stamped late, by the most conclusive position."""
    # If noise hides the difference, the stamps are used.
    positions = [log[name] for log in logs for name in log.those_of(POSITIONS)]
    even = np.arange(len(logs[0].time), dtype=np.float64)
    return are_smoother_at(even, logs[0].time, positions, recordings)


def check_typical(file: str, place: str, typical: float, steps: FloatArray) -> None:
    """Raise if a typical step, in s, is not a plausible sample time of a drive."""
    if is_sample_time(typical):
        return
    fitting = (unit for unit, size in _UNITS.items() if is_sample_time(size * typical))
    remedy = f"name the unit of the time, as in [{next(fitting, 'ms')}]"
    if np.all(steps == 1.0):
        remedy = (
            f"if it numbers the samples, give the sample time in a column map, as scale = 0.001 "
            f"for 1 ms; else {remedy}"
        )
    reason = f"the sample time would be {typical:.4g} s, which no drive log has: {remedy}"
    raise RecordingError(file, place, reason)


def _rounded_step(log: Draft) -> float | None:
    """Sample time of even times that were rounded to few digits, in s; None if they were not."""
    time = log.time
    sample_time = _fitted_sample_time(time, [slice(0, len(time))])
    off = np.ptp(time - sample_time * np.arange(len(time)))
    if off <= 2.0 * EVEN * sample_time:
        return None
    digit = _last_digit(time)
    is_rounded = 0.5 * digit < np.ptp(np.diff(time)) and off <= ROUNDED * digit
    if not is_rounded or digit > _MOST_PER_DIGIT * sample_time:
        return None
    warn_rounded(log, "time", digit, sample_time)
    return sample_time


def warn_rounded(
    log: Draft, place: str, digit: float, sample_time: float, rank: Rank = Rank.NOTE
) -> None:
    """Warn of even times that were rounded to a digit; both arguments in s."""
    log.warn(
        place,
        f"the times are rounded to {digit * 1e3:g} ms; they fit even steps of "
        f"{sample_time * 1e3:.6g} ms, which were taken: write the time with more digits",
        rank,
    )


def _last_digit(time: FloatArray) -> float:
    """Largest power of ten, in s, of which all times are multiples; zero without one."""
    for power in range(0, -7, -1):
        numbers = (time - time[0]) / 10.0**power
        if np.abs(numbers - np.rint(numbers)).max() < EVEN:
            return 10.0**power
    return 0.0


def interpolated(time: FloatArray, values: FloatArray, at: FloatArray, *, held: bool) -> FloatArray:
    """Return a channel at other times, by a cubic spline, or without overshoot if it is `held`."""
    from scipy.interpolate import CubicSpline, PchipInterpolator

    interpolator = PchipInterpolator if held else CubicSpline
    with np.errstate(over="ignore"):  # 1 / slope may overflow, which gives slope 0
        return np.asarray(interpolator(time, values)(at), dtype=np.float64)


def is_sample_time(seconds: float) -> bool:
    """Whether a sample time is plausible for a drive."""
    return SHORTEST_SAMPLE_TIME <= seconds <= LONGEST_SAMPLE_TIME


def check_sample_time(sample_time: float) -> None:
    """Raise a `SettingError` if a sample time, in s, is not plausible for a drive."""
    if not is_sample_time(sample_time):
        raise SettingError(
            "sample_time",
            f"{sample_time:g} s is outside {SHORTEST_SAMPLE_TIME:g} to {LONGEST_SAMPLE_TIME:g} s: "
            f"check the unit",
        )


def _uneven_error(log: Draft, steps: FloatArray) -> RecordingError:
    time = log.time
    changes = _changes(np.diff(time))
    remedy = "record at a fixed rate, or write the time with more digits"
    if len(changes) == 1:
        there = f"{time[changes[0] + 1]:.6g} s"
        remedy = f"cut the log at {there}, where the sample time changes, into two logs"
    return log.refusal(
        "time",
        f"the time steps vary between {steps.min() * 1e3:.4g} and {steps.max() * 1e3:.4g} ms: "
        f"{remedy}",
    )


def _changes(steps: FloatArray) -> NDArray[np.int64]:
    """Indices of the steps before a change of the step."""
    return np.flatnonzero(np.abs(np.diff(steps)) > MOST_JITTER * steps.min())


def _warn_of_gaps(
    log: Draft, is_gap: NDArray[np.bool_], parts: list[slice], recordings: list[slice]
) -> None:
    """Warn of gaps, and of parts between cuts that are too short for a recording."""
    gaps = log.spans(
        (place, place + 1)
        for place in np.flatnonzero(is_gap).tolist()
        if log.time[place] not in log.restarts
    )
    if gaps:
        count = f"{len(recordings)} recording{'' if len(recordings) == 1 else 's'}"
        log.warn(
            "",
            f"samples are missing from {gaps}, so the log was cut there into {count}: record "
            f"without gaps",
        )
    short = log.spans((part.start, part.stop - 1) for part in parts if part not in recordings)
    if short:
        log.warn(
            "",
            f"the samples from {short} were dropped, since fewer than {FEWEST_SAMPLES} lie between "
            f"two gaps: record without gaps",
        )


def _fitted_sample_time(time: FloatArray, recordings: Sequence[slice]) -> float:
    """Least-squares slope of the time over the sample number, common to all recordings, in s."""
    products, squares = 0.0, 0.0
    for recording in recordings:
        stamps = time[recording] - time[recording].mean()
        numbers = np.arange(len(stamps)) - 0.5 * (len(stamps) - 1)
        products += float(numbers @ stamps)
        squares += float(numbers @ numbers)
    return products / squares
