"""Correction of spikes of an encoder, of late time stamps, and of lost samples.

Spikes: a sample is compared with the cubic through its four neighbours. If it differs by much more
than the noise, while the motion around it is smooth, it is a spike.
"""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.recording.jumps import unwrapped
from flexid.recording.late_stamps import even_with_losses
from flexid.recording.lost_samples import (
    CLEAR,
    FEWEST_PLACES,
    all_times,
    even_times,
    evidence_of_losses,
    logged_indices,
    lost_by_the_clock,
    lost_samples,
    with_hidden_losses,
)
from flexid.recording.recording import INPUTS, POSITIONS, Draft, Rank
from flexid.recording.roughness import are_smoother_at
from flexid.recording.sampling import (
    WIDE_GAP,
    are_gaps,
    interpolated,
    parts_between,
    warn_rounded,
    warn_uneven,
)
from flexid.recording.velocities import position_noise

_FROM_CUBIC = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0  # distance from the neighbours' cubic
_SPIKE = 20.0  # least size of a spike over the noise: 14 standard deviations of the distance
_CALM = 0.4  # largest second difference around a spike over its size; above 1 at a sudden stop
_END = 0.1  # of a counter's range: distance from its ends at which it may overflow
_AROUND = 8  # samples on either side of a spike that must be smooth
_AT_ONCE = 65_536  # places per batch, to limit memory: without noise all are candidates
_MOST = 0.01  # largest share of spikes that are replaced: more are not single errors


def mend(logs: Sequence[Draft]) -> None:
    """Replace spikes of encoders, and interpolate samples that all joints of a file lost."""
    first = logs[0]
    if len(first.time) < 4 * _AROUND:
        return
    sensors = [(log, name) for log in logs for name in log.those_of(POSITIONS)]
    with np.errstate(all="ignore"):  # values are not yet checked
        for log, name in sensors:
            _mend_spikes(log, name)
        positions = [unwrapped(log, name) for log, name in sensors if np.ptp(log[name])]
        _take_even_times(logs, positions)
        counted = even_times(first.time, positions)
        if counted is not None:
            digit, step = np.median(np.diff(first.time)), np.min(np.diff(counted))
            warn_rounded(first, "the time", float(digit), float(step), Rank.DATA)
            for log in logs:
                log["time"] = counted
        time = first.time
        lost = lost_samples(positions, time)
        _check_all_lost(logs, time, lost)
        seen = np.count_nonzero(lost) >= FEWEST_PLACES
        every = with_hidden_losses(positions, lost) if seen else np.zeros_like(lost)
    missing = lost_by_the_clock(time)
    if missing.any():
        places = np.flatnonzero(missing)
        first.warn(
            "",
            f"{missing.sum()} samples are missing in {len(places)} places (after "
            f"{first.at(places)}), up to three in each, so they were interpolated: "
            f"record without gaps",
            Rank.DATA,
        )
        kept = logged_indices(missing)
        time = np.interp(np.arange(kept[-1] + 1), kept, time)
    elif every.any():
        places, missing = np.flatnonzero(lost), every
        hidden = missing.sum() - lost.sum()
        more = f", probably {hidden} more where noise hides them," if hidden else ""
        first.warn(
            [name for log, name in sensors if log is first],
            f"in {len(places)} places all positions advance by additional whole steps "
            f"(at {first.at(places)}): {lost.sum()} samples were lost{more} and the time was "
            f"counted without them, so they were interpolated: log the time of each sample",
            Rank.DATA,
        )
        time = all_times(time, missing, is_span=counted is not None)
    for log in logs:
        _put_back(log, missing, time)


def _take_even_times(logs: Sequence[Draft], positions: list[FloatArray]) -> None:
    """Correct late stamps between which samples are lost, if the positions show both."""
    first = logs[0]
    even = even_with_losses(first.time)
    if even is None or not positions:
        return
    steps = np.diff(first.time)
    step = float(np.median(np.diff(even)))
    whole = np.rint(np.diff(even) / step)
    evidence = evidence_of_losses(np.column_stack(positions), whole == 2.0)
    parts = parts_between(whole > WIDE_GAP)
    if evidence <= CLEAR or not are_smoother_at(even, first.time, positions, parts):
        return
    within = whole <= WIDE_GAP
    percent = 100.0 * float(np.abs(steps[within] / step - whole[within]).max())
    taken = "the positions are smoother at even times with lost samples, so these were taken"
    warn_uneven(first, percent, step, taken)
    for log in logs:
        log["time"] = even


def _check_all_lost(logs: Sequence[Draft], time: FloatArray, lost: NDArray[np.int64]) -> None:
    """Raise if one joint of several has lost samples that the others have."""
    for log in logs if len(logs) > 1 else ():
        own = [unwrapped(log, name) for name in log.those_of(POSITIONS) if np.ptp(log[name])]
        places = np.flatnonzero(lost_samples(own, time) > lost)
        if len(places) >= FEWEST_PLACES:
            raise log.refusal(
                log.those_of(POSITIONS),
                f"samples are missing in this joint only (at {log.at(places)}): export the joints "
                f"on one clock, without gaps",
            )


def _put_back(log: Draft, lost: NDArray[np.int64], time: FloatArray) -> None:
    """Interpolate lost samples at the times `time`; inputs without overshoot, as they may step."""
    if not lost.any():
        log["time"] = time
        return
    kept = logged_indices(lost)
    log["time"] = time[kept]
    every = np.arange(kept[-1] + 1.0)
    for name in log.names:
        there, smooth = log[name], unwrapped(log, name)
        found = interpolated(kept.astype(np.float64), smooth, every, held=name in INPUTS)
        log[name] = _with_wraps(found, there, there - smooth, 1 + lost)
        log[name][kept] = there
    log["time"] = time


def _with_wraps(
    unwrapped_values: FloatArray, logged: FloatArray, turns: FloatArray, counts: NDArray[np.int64]
) -> FloatArray:
    """Add an encoder's turns to each logged sample and to those put back after it.

    Where an encoder wraps within a gap, the samples that would leave its range have wrapped.
    """
    before = unwrapped_values + np.repeat(turns, np.append(counts, 1))
    after = unwrapped_values + np.append(np.repeat(turns[1:], counts), turns[-1])
    is_within = (logged.min() <= before) & (before <= logged.max())
    return np.where(is_within, before, after)


def _mend_spikes(log: Draft, name: str) -> None:
    """Replace the spikes of a position if they are few."""
    values = log[name].copy()
    even = ~are_gaps(log.time)
    places, sizes = _spikes(values, even)
    if len(places):  # an encoder may also wrap for a single sample
        is_spike = np.isin(places, _spikes(unwrapped(log, name), even)[0])
        places, sizes = places[is_spike], sizes[is_spike]
    if not 0 < len(places) <= max(1.0, _MOST * len(values)):
        return
    values[places] -= sizes
    log[name] = values
    single = "sample is" if len(places) == 1 else "samples are"
    log.warn(
        name,
        f"{len(places)} {single} off the neighbouring ones by up to {np.abs(sizes).max():.2g} "
        f"{log.channels[name].unit} (at {log.at(places)}), so a cubic through those was taken "
        f"instead: check the sensor and its cable",
        Rank.DATA,
    )


def _spikes(values: FloatArray, even: NDArray[np.bool_]) -> tuple[NDArray[np.int64], FloatArray]:
    """Indices and sizes of single samples that differ from their neighbours."""
    off = np.zeros(len(values))
    off[2:-2] = np.convolve(values, _FROM_CUBIC, mode="valid")
    suspect = np.abs(off) > _SPIKE * position_noise(values)
    usual = values[~suspect]
    low, high = usual.min(initial=np.inf), usual.max(initial=-np.inf)
    places = np.flatnonzero(suspect[_AROUND:-_AROUND]) + _AROUND
    sizes = off[places]
    parts = np.array_split(places, 1 + len(places) // _AT_ONCE)
    is_alone = np.concatenate([_is_calm_around(values, part, off[part]) for part in parts])
    is_alone &= sliding_window_view(even, 4)[places - 2].all(axis=1)
    # A counter near its overflow may alternate between the ends of its range.
    before, after = values[places], values[places] - sizes
    lowest, highest = np.minimum(before, after), np.maximum(before, after)
    is_within = (low <= before) & (before <= high)
    is_turn = np.maximum(np.abs(lowest - low), np.abs(high - highest)) < _END * (high - low)
    is_alone &= ~(is_within & is_turn)
    return places[is_alone], sizes[is_alone]


def _is_calm_around(
    values: FloatArray, places: NDArray[np.int64], sizes: FloatArray
) -> NDArray[np.bool_]:
    """Whether the motion around each place is smooth after a spike of this size is removed."""
    bends = np.diff(sliding_window_view(values, 2 * _AROUND + 1)[places - _AROUND], 2)
    bends = (bends - np.median(bends, axis=1)[:, None]) / np.abs(sizes)[:, None]
    # A spike has second differences as 1, -2, 1; a jump of the velocity has one sign.
    middle = _AROUND - 1  # second difference centred on the sample
    bends[:, middle - 1 : middle + 2] -= np.outer(np.sign(sizes), [1.0, -2.0, 1.0])
    return ~(np.abs(bends).max(axis=1) > _CALM)
