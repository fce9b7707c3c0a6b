"""Time stamps to an even grid: gaps cut the log into recordings, jitter is interpolated away."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError, SettingError
from flexid.recording.clock import digits_of, is_time_of_day

if TYPE_CHECKING:
    from flexid.arrays import FloatArray
    from flexid.recording.table import Table

FEWEST_SAMPLES = 20  # of a recording
FEWEST_TO_IDENTIFY = 75  # of a recording: 50 to fit, and a third that is kept out
LONGEST_SAMPLE_TIME = 0.5  # s
SHORTEST_SAMPLE_TIME = 1e-6  # s
GAP = 1.5  # sample times between two samples; a single lost sample makes 2
MOST_GAPS = 0.05  # share of the steps
EVEN = 1e-3  # of a sample time: what a printed time is off by
MOST_JITTER = 0.1  # of a sample time
_ROUNDED = 1.05  # digits: rounded times lie within one, and a fitted line is a little off


@dataclass(frozen=True, eq=False)
class Grid:
    """Where the recordings of a log lie, and on which even times.

    Parameters
    ----------
    sample_time : float
        Common to all recordings, in s.
    recordings : tuple of slice
        The samples of each recording.
    resample : bool
        Whether the time stamps are off the even grid by more than rounding.
    warnings : tuple of str
    """

    sample_time: float
    recordings: tuple[slice, ...]
    resample: bool
    warnings: tuple[str, ...]


def check_increasing(table: Table, column: str, time: FloatArray) -> None:
    """Raise unless time increases from row to row.

    Raises
    ------
    RecordingError
        Naming the first row that does not come after the one before.
    """
    steps = np.diff(time)
    if np.all(steps > 0.0):
        return
    index = int(np.argmax(~(steps > 0.0))) + 1
    before, now = f"{time[index - 1]:.9g}", f"{time[index]:.9g}"
    reason = (
        f"time repeats ({now} s): remove the repeated row, or write the time with more digits"
        if time[index] == time[index - 1]
        else f"time runs backwards (from {before} s to {now} s): sort the rows, or cut the file "
        f"there into two logs"
    )
    if abs(time[index] - time[index - 1] + 3600.0) < 1.0:
        reason += "; if the clock was set to winter time, log the time in UTC"
    elif time[index] < time[index - 1] and column in table.names:
        by = float(time[index - 1] - time[index])
        cells = table.frame[column]
        reason += _stamp_hint(cells[index - 1], cells[index], by)
    raise RecordingError(table.file, table.place(index, column), reason)


def _stamp_hint(before: object, now: object, by: float) -> str:
    """What may be wrong with two cells, if they are stamps that run backwards by so many s."""
    if by > 3600.0 and is_time_of_day(now):
        return (
            "; times of day are taken to be less than 12 h apart: after a longer gap, or of a "
            "clock that counts to 12, write the date before the time"
        )
    digits = digits_of(before), digits_of(now)
    if digits[0] == digits[1] or not all(digits):
        return ""
    return f"; {str(now).strip()!r} may lack zeros behind the point"


def even_grid(table: Table, column: str, time: FloatArray) -> Grid:
    """Find the sample time and the gaps of increasing time stamps.

    Parameters
    ----------
    table : Table
        For the places in messages.
    column : str
        Where the time stands.
    time : FloatArray, shape (n,)
        Increasing, in s.

    Returns
    -------
    Grid

    Raises
    ------
    RecordingError
        If the samples are too few, or the sample time implausible or too uneven.
    """
    place = f"column {column!r}"
    _check_count(table.file, len(time))
    steps = np.diff(time)
    typical = float(np.median(steps))
    _check_sample_time(table.file, place, typical)
    rounded = _of_rounded(table.file, place, time, steps)
    if rounded is not None:
        return rounded
    is_gap = steps > GAP * typical
    if is_gap.mean() > MOST_GAPS:
        raise _uneven(table.file, place, steps)
    cuts = [0, *(np.flatnonzero(is_gap) + 1).tolist(), len(time)]
    all_recordings = [slice(a, b) for a, b in pairwise(cuts)]
    recordings = [
        recording
        for recording in all_recordings
        if recording.stop - recording.start >= FEWEST_SAMPLES
    ]
    if not recordings:
        raise RecordingError(
            table.file,
            place,
            f"gaps leave no {FEWEST_SAMPLES} samples in a row: record without gaps",
        )
    warnings = _gap_warnings(table.file, time, all_recordings, recordings)
    sample_time = _fitted_sample_time(time, recordings)
    off_grid = max(_off_grid(time[recording], sample_time) for recording in recordings)
    within = np.concatenate([np.diff(time[recording]) for recording in recordings])
    # A time stamp that is late lengthens one step and shortens the next.
    jitter = float(np.abs(within / sample_time - 1.0).max()) / 2.0
    if off_grid <= EVEN:
        return Grid(sample_time, tuple(recordings), False, warnings)
    if jitter > MOST_JITTER:
        raise _uneven(table.file, place, within)
    warnings += (
        f"{table.file}: {place}: the time steps vary by {200.0 * jitter:.2g} % of the sample time "
        f"of {sample_time * 1e3:.6g} ms, so the channels were interpolated to even times: record "
        f"at a fixed rate, or write the time with more digits",
    )
    return Grid(sample_time, tuple(recordings), True, warnings)


def _of_rounded(file: str, place: str, time: FloatArray, steps: FloatArray) -> Grid | None:
    """The even grid of times that are off it by no more than their last digit; None if they are.

    Of 400 samples per second, written in whole milliseconds, two come 3 ms after the one before and
    two 2 ms: they are even all the same, and interpolation would make them uneven.
    """
    sample_time = _fitted_sample_time(time, [slice(0, len(time))])
    off = np.ptp(time - sample_time * np.arange(len(time)))
    if off <= 2.0 * EVEN * sample_time:
        return None
    digit = _last_digit(time)
    if not (0.5 * digit < np.ptp(steps) <= _ROUNDED * digit and off <= _ROUNDED * digit):
        return None
    warning = (
        f"{file}: {place}: the times are rounded to {digit * 1e3:g} ms; they fit even steps of "
        f"{sample_time * 1e3:.6g} ms, which were taken: write the time with more digits"
    )
    return Grid(sample_time, (slice(0, len(time)),), False, (warning,))


def _last_digit(time: FloatArray) -> float:
    """The largest power of ten in s of which all times are multiples; zero if there is none."""
    for power in range(0, -7, -1):
        numbers = (time - time[0]) / 10.0**power
        if np.abs(numbers - np.rint(numbers)).max() < EVEN:
            return 10.0**power
    return 0.0


def to_grid(
    time: FloatArray, values: FloatArray, sample_time: float, held: bool = False
) -> FloatArray:
    """Interpolate a channel to even times from its first time stamp on.

    Parameters
    ----------
    time, values : FloatArray, shape (n,)
    sample_time : float
    held : bool
        Whether the channel may step, as an input does: interpolated without overshoot.

    Returns
    -------
    FloatArray, shape (m,)
        At ``time[0] + sample_time * k``, as far as the time stamps reach.
    """
    count = int((time[-1] - time[0]) / sample_time + EVEN) + 1
    even = np.minimum(time[0] + sample_time * np.arange(count), time[-1])
    return interpolated(time, values, even, held=held)


def interpolated(time: FloatArray, values: FloatArray, at: FloatArray, *, held: bool) -> FloatArray:
    """A channel at other times; one that may step is interpolated without overshoot.

    Parameters
    ----------
    time, values : FloatArray, shape (n,)
    at : FloatArray, shape (m,)
    held : bool
        Whether it may step.

    Returns
    -------
    FloatArray, shape (m,)
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator

    interpolator = PchipInterpolator if held else CubicSpline
    with np.errstate(over="ignore"):  # one over a slope next to none: the mean slope is then none
        return np.asarray(interpolator(time, values)(at), dtype=np.float64)


def _check_count(file: str, count: int) -> None:
    if count < FEWEST_SAMPLES:
        found = "is 1 sample" if count == 1 else f"are {count} samples"
        raise RecordingError(
            file,
            "",
            f"there {found} where {FEWEST_SAMPLES} are the fewest that are read, and "
            f"{FEWEST_TO_IDENTIFY} the fewest that can be identified: record for longer",
        )


def check_sample_time(sample_time: float) -> None:
    """Raise a `SettingError` unless a drive may be sampled so, in s."""
    if not SHORTEST_SAMPLE_TIME <= sample_time <= LONGEST_SAMPLE_TIME:
        raise SettingError(
            "sample time",
            f"{sample_time:g} s is no drive's: give {SHORTEST_SAMPLE_TIME:g} to "
            f"{LONGEST_SAMPLE_TIME:g} s",
        )


def _check_sample_time(file: str, place: str, sample_time: float) -> None:
    if not SHORTEST_SAMPLE_TIME <= sample_time <= LONGEST_SAMPLE_TIME:
        raise RecordingError(
            file,
            place,
            f"the sample time would be {sample_time:.4g} s, which no drive log has: name the unit "
            f"of the time, as in [ms]",
        )


def _uneven(file: str, place: str, steps: FloatArray) -> RecordingError:
    return RecordingError(
        file,
        place,
        f"the time steps vary between {steps.min() * 1e3:.4g} and {steps.max() * 1e3:.4g} ms: "
        f"record at a fixed rate, or write the time with more digits",
    )


def _gap_warnings(
    file: str, time: FloatArray, all_recordings: list[slice], recordings: list[slice]
) -> tuple[str, ...]:
    warnings = []
    if len(all_recordings) > 1:
        gaps = [
            f"{time[a.stop - 1]:.6g} s to {time[b.start]:.6g} s"
            for a, b in pairwise(all_recordings)
        ]
        warnings.append(
            f"{file}: samples are missing from {_listed(gaps)}, so the log was cut there into "
            f"{len(recordings)} recording{'' if len(recordings) == 1 else 's'}: record without gaps"
        )
    short = [
        f"{time[recording.start]:.6g} s to {time[recording.stop - 1]:.6g} s"
        for recording in all_recordings
        if recording not in recordings
    ]
    if short:
        warnings.append(
            f"{file}: the samples from {_listed(short)} were dropped, since fewer than "
            f"{FEWEST_SAMPLES} lie between two gaps: record without gaps"
        )
    return tuple(warnings)


def _listed(items: list[str]) -> str:
    if len(items) > 4:
        return ", ".join(items[:3]) + f" and {len(items) - 3} more times"
    return ", ".join(items)


def _fitted_sample_time(time: FloatArray, recordings: list[slice]) -> float:
    """Return the least-squares slope of time over the sample's number, common to all recordings."""
    products, squares = 0.0, 0.0
    for recording in recordings:
        stamps = time[recording] - time[recording].mean()
        numbers = np.arange(len(stamps)) - 0.5 * (len(stamps) - 1)
        products += float(numbers @ stamps)
        squares += float(numbers @ numbers)
    return products / squares


def _off_grid(stamps: FloatArray, sample_time: float) -> float:
    """Return how far time stamps are off an even grid at most, in sample times."""
    residual = stamps - sample_time * np.arange(len(stamps))
    return float(np.abs(residual - np.median(residual)).max()) / sample_time
