"""Single samples that no motion explains: spikes of an encoder, and samples that are lost.

Spikes: a sample is compared with the cubic through its four neighbours. What differs by much more
than noise while all around it is calm is no motion.

Lost samples: where the time was counted from the samples that are there, every position advances by
one more step than around it. What the steps around speak for, with and without samples lost, is
learnt from the log itself by least squares; both are compared by their likelihood for all positions
together.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.recording.recording import INPUTS, POSITIONS, Draft, Rank
from flexid.recording.sampling import (
    EVEN,
    MOST_GAPS,
    MOST_JITTER,
    ROUNDED,
    are_gaps,
    interpolated,
    warn_rounded,
)
from flexid.recording.velocities import position_noise

_NEAR = 4  # steps on either side
_MOST_LOST = 3  # samples in one place; a longer gap is a gap
_CLEAR = 10.0  # of the logarithm of the likelihoods' ratio: a chance of 1 in 20 000
_LEAST_SHARE = 4.0  # times as many places as there are where a step seems to be one too many
_LEAST_SPEED = 0.3  # of the usual one, where samples are lost: they are lost at any speed
_LEAST_EXPLAINED = 0.75  # of the places, where samples were lost and nothing else happened
_LEFT_OVER = 0.05  # of an error's square that a loss leaves at most, beyond what is by chance
_BY_CHANCE = 10.0  # square of an error over its variance
_NEARBY = 200  # steps, of which few are over lost samples
_PASSES = 8  # over the log: a place hides those next to it
_TRIMS, _TRIMMED = 4, 5.0  # rounds of learning without steps that are off by so many deviations
_FEWEST_WINDOWS = 60  # for each channel: several times as many as there are weights
_MOST_WINDOWS = 5_000  # learnt from: more make it slower and no better
_ALIKE = 1e-10  # singular values over the largest, and errors over steps, that count as none
FEWEST_PLACES = 3  # where samples are lost: fewer change next to nothing
_SHORTEST_PART = 2.0  # s between losses that the clock shows: a log of longer parts is cut instead


def lost_samples(positions: list[FloatArray], time: FloatArray) -> NDArray[np.int64]:
    """How many samples are lost after each, shape (n - 1,); all 0 where nothing shows it."""
    none = np.zeros(len(time) - 1, dtype=np.int64)
    steps = np.diff(time)
    is_counted = np.ptp(steps) <= EVEN * np.median(steps)
    if not positions or len(time) < _FEWEST_WINDOWS * len(positions) or not is_counted:
        return none
    seen = np.column_stack(positions)
    lost = none
    for _ in range(_PASSES):
        more, ratio = _likeliest(seen, lost)
        clear = ratio > _CLEAR
        one_too_many = np.count_nonzero(lost) + np.count_nonzero(clear & (more > 0))
        # Where the motion itself makes steps uneven it stops as often as it doubles.
        least = max(FEWEST_PLACES, _LEAST_SHARE * np.count_nonzero(clear & (more < 0)))
        if one_too_many < least:
            return none
        # A loss spoils the windows around it, so that the clearest of them goes first.
        around = np.pad(ratio, _NEAR, mode="edge")
        clearest = ratio >= sliding_window_view(around, 2 * _NEAR + 1).max(axis=1)
        added = np.where(clear & clearest & (more > 0), more, 0)
        if not added.any():
            break
        lost = lost + added
        if _windows_without(lost) < _FEWEST_WINDOWS * len(positions):
            return none
    explained = lost * _explained(seen, lost)
    # Friction bends a motion where it turns round: samples are lost at any speed.
    speeds = np.abs(np.diff(seen, axis=0))
    speeds = np.mean(speeds / (speeds.mean(axis=0) + np.finfo(float).tiny), axis=1)
    if explained.any() and not np.median(speeds[explained > 0]) > _LEAST_SPEED:
        return none
    enough = np.count_nonzero(explained) >= _LEAST_EXPLAINED * np.count_nonzero(lost)
    return explained if enough else none


def _windows_without(lost: NDArray[np.int64]) -> int:
    """How many windows there are, as long as any that is learnt from, in which nothing is lost."""
    gone = np.cumsum(np.concatenate(([0], lost > 0)))
    length = 2 * _NEAR + _MOST_LOST + 1
    return int(np.count_nonzero(gone[length:] == gone[:-length]))


def lost_by_the_clock(time: FloatArray) -> NDArray[np.int64]:
    """How many samples are missing after each, shape (n - 1,), where they are few but often."""
    steps = np.diff(time) / np.median(np.diff(time))
    whole = np.rint(steps)
    is_short = whole <= _MOST_LOST + 1
    off = np.abs(steps - whole)
    lost = np.where(is_short & (whole >= 2) & (off <= MOST_JITTER), whole - 1, 0).astype(np.int64)
    if np.mean(is_short & (off > 2.0 * MOST_JITTER)) > MOST_GAPS:
        return np.zeros_like(lost)  # steps of any length: a late stamp, too, doubles some
    places = np.count_nonzero(lost)
    # A cut loses no accuracy, interpolation a little: but a log in pieces shows no slow motion.
    is_often = places >= FEWEST_PLACES and places * _SHORTEST_PART > time[-1] - time[0]
    return lost if is_often and np.mean(lost > 0) <= MOST_GAPS else np.zeros_like(lost)


def counted_anew(time: FloatArray, positions: list[FloatArray]) -> FloatArray | None:
    """Even times where a coarse clock, no loss, doubles some of the steps; None elsewhere.

    Of 970 samples per second in whole milliseconds every 32nd step reads 2 ms. What the positions
    do there decides; where they tell nothing, whether double steps recur evenly, as of rounding.
    """
    steps = np.diff(time) / np.median(np.diff(time))
    whole = np.maximum(np.rint(steps), 1.0)
    doubled = whole == 2.0
    if not 0.0 < np.mean(doubled) <= MOST_GAPS or np.abs(steps - whole).max() > EVEN:
        return None
    evidence = _evidence_of_losses(np.column_stack(positions), doubled) if positions else 0.0
    if evidence > _CLEAR:
        return None
    is_gap = whole > _MOST_LOST + 1
    step = np.diff(time)[~is_gap].mean()
    number = np.cumsum(np.where(is_gap, np.rint(np.diff(time) / step), 1.0))
    counted = _evenly(time, np.concatenate(([0.0], number)))
    recurs = np.ptp(time - counted) <= ROUNDED * np.median(np.diff(time))
    is_rounding = recurs and np.count_nonzero(doubled) >= FEWEST_PLACES
    return counted if evidence < -_CLEAR or is_rounding else None


def _evenly(time: FloatArray, number: FloatArray) -> FloatArray:
    """The line in the number of a sample from which its time is off by least, at most."""
    step = (time[-1] - time[0]) / number[-1]
    nearby = step * (1.0 + np.array([-2.0, 2.0]) / number[-1])  # times are off by a step at most
    # Slow to import, and few clocks are coarse.
    from scipy.optimize import minimize_scalar

    found: Any = minimize_scalar(
        lambda each: np.ptp(time - each * number), bounds=nearby, options={"xatol": 1e-9 * step}
    )
    off = time - found.x * number
    return found.x * number + 0.5 * (off.min() + off.max())


def _evidence_of_losses(positions: FloatArray, suspected: NDArray[np.bool_]) -> float:
    """Logarithm of how much likelier a lost sample in each of these steps is than none."""
    steps = np.diff(positions, axis=0)
    places = np.flatnonzero(suspected)
    places = places[(places >= _NEAR) & (places < len(steps) - _NEAR)]
    if _windows_without(suspected.astype(np.int64)) < _FEWEST_WINDOWS * steps.shape[1]:
        return 0.0
    neighbours, own = _around(steps, places, 0)
    none, one = (_Interpolator.learnt(steps, ~suspected, count) for count in (0, 1))
    each = none.surprise(neighbours, own) - one.surprise(neighbours, own)
    return float(np.clip(each, -_CLEAR, _CLEAR).sum())  # no single shock decides


def counted_on(time: FloatArray, lost: NDArray[np.int64], *, is_span: bool) -> FloatArray:
    """The time of all samples where it was counted: its span is right, or its step."""
    count = len(time) + int(lost.sum())
    step = (time[-1] - time[0]) / ((count if is_span else len(time)) - 1)
    return time[0] + step * np.arange(count)


def _kept(lost: NDArray[np.int64]) -> NDArray[np.int64]:
    """Places of the samples that are there among all."""
    return np.concatenate(([0], np.cumsum(1 + lost)))


def _likeliest(
    positions: FloatArray, lost: NDArray[np.int64]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Samples lost at each step, and how much more likely that is than none; -1: a step missing."""
    steps, whole, firsts = _steps(positions, lost)
    tested = np.flatnonzero((firsts >= _NEAR) & (firsts < len(steps) - _NEAR) & (lost == 0))
    plain = _Interpolator.learnt(steps, whole, 0)
    off = plain.squares(*_around(steps, firsts[tested], 0))
    usual = _usual(off, steps.shape[1])
    unlikely = off > 2.0 * _CLEAR * usual  # the others are likely as they are
    tested, usual = tested[unlikely], usual[unlikely]
    number, ratio = np.zeros_like(lost), np.full(len(lost), -np.inf)
    if len(tested):
        neighbours, own = _around(steps, firsts[tested], 0)
        others = [_Interpolator.learnt(steps, whole, count) for count in range(1, _MOST_LOST + 1)]
        found = [plain.surprise(0.0 * neighbours, own)]
        found += [other.surprise(neighbours, own) for other in others]
        ratios = plain.surprise(neighbours, own) - np.array(found)
        best = np.argmax(ratios, axis=0)
        number[tested] = np.array([-1, *range(1, _MOST_LOST + 1)])[best]
        ratio[tested] = ratios[best, np.arange(len(best))] / usual
    return number, ratio


def _usual(squares: FloatArray, channels: int) -> FloatArray:
    """How much larger squares of errors are nearby than by chance, as in fast motion; 1 or more."""
    by_chance = channels * (1.0 - 2.0 / (9.0 * channels)) ** 3  # median of their sum
    parts = np.array_split(squares, max(1, len(squares) // _NEARBY))
    each = [
        np.full(len(part), max(1.0, np.median(part) / by_chance)) for part in parts if len(part)
    ]
    return np.concatenate(each) if each else np.ones(0)


def _explained(positions: FloatArray, lost: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Where losses leave next to nothing of an error, shape (n - 1,): what hits a joint does."""
    steps, whole, firsts = _steps(positions, lost)
    found = np.ones(len(lost), dtype=bool)
    for number in np.unique(lost[lost > 0]).tolist():
        inside = (firsts >= _NEAR) & (firsts < len(steps) - _NEAR - number) & (lost == number)
        neighbours, own = _around(steps, firsts[inside], number)
        lossy = _Interpolator.learnt(steps, whole, number)
        off = lossy.squares(neighbours / (number + 1.0), own)
        found[inside] = lossy.squares(neighbours, own) <= _BY_CHANCE + _LEFT_OVER * off
    return found


@dataclass(frozen=True, eq=False)
class _Interpolator:
    """What steps of all positions together the steps around speak for, learnt from a log."""

    weights: FloatArray  # (2 * _NEAR * channels + 1, channels)
    root: FloatArray  # (channels, channels): Cholesky factor of its errors' covariance

    @classmethod
    def learnt(cls, steps: FloatArray, whole: NDArray[np.bool_], lost: int) -> "_Interpolator":
        """That of a step over so many lost samples, from windows in which nothing was lost."""
        last = len(steps) - _NEAR - lost
        count = min(last - _NEAR, _MOST_WINDOWS)
        firsts = np.unique(np.linspace(_NEAR, last - 1, count).astype(np.int64))
        gone = np.cumsum(np.concatenate(([0], ~whole)))
        firsts = firsts[gone[firsts + _NEAR + lost + 1] == gone[firsts - _NEAR]]
        neighbours, sums = _around(steps, firsts, lost)
        weights, kept = np.zeros((neighbours.shape[1], steps.shape[1])), np.full(len(sums), True)
        errors = sums
        for _ in range(_TRIMS):
            weights = np.linalg.lstsq(neighbours[kept], sums[kept], rcond=_ALIKE)[0]
            errors = sums - neighbours @ weights
            usual = np.median(np.abs(errors[kept]), axis=0) / 0.6745 + np.finfo(float).tiny
            close = kept & (np.max(np.abs(errors) / usual, axis=1) < _TRIMMED)
            if np.array_equal(close, kept):
                break
            kept = close
        left = errors[kept]
        floor = _ALIKE * np.mean(steps**2, axis=0) + np.finfo(float).tiny
        root = np.linalg.cholesky(left.T @ left / max(len(left), 1) + np.diag(floor))
        return cls(weights.astype(np.float64), root.astype(np.float64))

    def surprise(self, neighbours: FloatArray, own: FloatArray) -> FloatArray:
        """Minus the logarithm of each step's likelihood."""
        return 0.5 * self.squares(neighbours, own) + np.sum(np.log(np.diag(self.root)))

    def squares(self, neighbours: FloatArray, own: FloatArray) -> FloatArray:
        """Squares of the errors of steps over their variance, shape (m,)."""
        return np.sum(np.linalg.solve(self.root, (own - neighbours @ self.weights).T) ** 2, axis=0)


def _steps(
    positions: FloatArray, lost: NDArray[np.int64]
) -> tuple[FloatArray, NDArray[np.bool_], NDArray[np.int64]]:
    """Steps of a log with its losses put back, which of them were seen, and where each began."""
    kept = _kept(lost)
    if lost.any():
        from scipy.interpolate import CubicSpline  # half a second, and few logs lose samples

        positions = CubicSpline(kept, positions)(np.arange(kept[-1] + 1))
    steps = np.diff(positions, axis=0)
    whole = np.repeat(lost == 0, 1 + lost)
    return steps, whole, kept[:-1]


def _around(
    steps: FloatArray, firsts: NDArray[np.int64], lost: int
) -> tuple[FloatArray, FloatArray]:
    """The steps on either side of one that covers so many lost samples, a constant; that step."""
    offsets, channels = [*range(-_NEAR, 0), *range(lost + 1, lost + 1 + _NEAR)], steps.shape[1]
    neighbours = np.ones((len(firsts), len(offsets) * channels + 1))
    for place, offset in enumerate(offsets):
        neighbours[:, place * channels : (place + 1) * channels] = steps[firsts + offset]
    own = steps[firsts]
    for offset in range(1, lost + 1):
        own += steps[firsts + offset]
    return neighbours, own


_OFF = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0  # what a cubic through the others leaves over
_SPIKE = 20.0  # times the noise, by which a spike is off: 14 standard deviations
_CALM = 0.4  # of a spike, up to which the motion around it bends; where it stops dead, more than 1
_AROUND = 8  # samples on either side
_AT_ONCE = 65_536  # places, as memory is limited: of a log without noise, all are looked at
_MOST = 0.01  # share of spikes, up to which a channel is mended: more are no single errors


def mend(logs: Sequence[Draft]) -> None:
    """Replace spikes of encoders, and put back samples that the joints of a file lost together."""
    first = logs[0]
    if len(first.time) < 4 * _AROUND:
        return
    sensors = [(log, name) for log in logs for name in log.those_of(POSITIONS)]
    with np.errstate(all="ignore"):  # of numbers that no check has refused yet
        for log, name in sensors:
            _mend_spikes(log, name)
        positions = [log[name] for log, name in sensors if np.ptp(log[name])]
        counted = counted_anew(first.time, positions)
        if counted is not None:
            digit, step = np.median(np.diff(first.time)), np.min(np.diff(counted))
            warn_rounded(first, "the time", float(digit), float(step), Rank.DATA)
            for log in logs:
                log["time"] = counted
        time = first.time
        lost = lost_samples(positions, time)
        _check_all_lost(logs, time, lost)
    missing = lost_by_the_clock(time)
    if missing.any():
        places = np.flatnonzero(missing)
        first.warn(
            "",
            f"{missing.sum()} samples are missing in {len(places)} places (after "
            f"{first.at(places)}), up to three in each, so they were put back by interpolation: "
            f"record without gaps",
            Rank.DATA,
        )
        kept = _kept(missing)
        time = np.interp(np.arange(kept[-1] + 1), kept, time)
    elif np.count_nonzero(lost) >= FEWEST_PLACES:
        places, missing = np.flatnonzero(lost), lost
        first.warn(
            [name for log, name in sensors if log is first],
            f"in {len(places)} places all positions advance by whole steps more than around them "
            f"(at {first.at(places)}): {lost.sum()} samples were lost and the time counted from "
            f"the rest, so they were put back by interpolation: log the time of each sample",
            Rank.DATA,
        )
        time = counted_on(time, lost, is_span=counted is not None)
    for log in logs:
        _put_back(log, missing, time)


def _check_all_lost(logs: Sequence[Draft], time: FloatArray, lost: NDArray[np.int64]) -> None:
    """Raise where one joint of several has lost samples that the others have not."""
    for log in logs if len(logs) > 1 else ():
        own = [log[name] for name in log.those_of(POSITIONS) if np.ptp(log[name])]
        places = np.flatnonzero(lost_samples(own, time) > lost)
        if len(places) >= FEWEST_PLACES:
            raise log.refusal(
                log.those_of(POSITIONS),
                f"samples are missing in this joint only (at {log.at(places)}): export the joints "
                f"on one clock, without gaps",
            )


def _put_back(log: Draft, lost: NDArray[np.int64], time: FloatArray) -> None:
    """Put lost samples back, at the times of all: an input without overshoot, as it may step."""
    log["time"] = time
    if not lost.any():
        return
    kept = _kept(lost)
    every = np.arange(kept[-1] + 1.0)
    for name in log.names:
        there = log[name]
        log[name] = interpolated(kept.astype(np.float64), there, every, held=name in INPUTS)
        log[name][kept] = there


def _mend_spikes(log: Draft, name: str) -> None:
    """Replace the spikes of a position, where they are few."""
    values = log[name].copy()
    places, sizes = _spikes(values, ~are_gaps(log.time))
    if not 0 < len(places) <= max(1.0, _MOST * len(values)):
        return
    values[places] -= sizes
    log[name] = values
    single = "sample is" if len(places) == 1 else "samples are"
    log.warn(
        name,
        f"{len(places)} {single} off the samples around by up to {np.abs(sizes).max():.2g} "
        f"{log.channels[name].unit} (at {log.at(places)}), so a cubic through these was taken "
        f"instead: check the sensor and its cable",
        Rank.DATA,
    )


def _spikes(values: FloatArray, even: NDArray[np.bool_]) -> tuple[NDArray[np.int64], FloatArray]:
    """Place and size of each sample that is off alone."""
    off = np.zeros(len(values))
    off[2:-2] = np.convolve(values, _OFF, mode="valid")
    suspect = np.abs(off) > _SPIKE * position_noise(values)
    usual = values[~suspect]
    low, high = usual.min(initial=np.inf), usual.max(initial=-np.inf)
    places = np.flatnonzero(suspect[_AROUND:-_AROUND]) + _AROUND
    sizes = off[places]
    parts = np.array_split(places, 1 + len(places) // _AT_ONCE)
    is_alone = np.concatenate([_is_calm_around(values, part, off[part]) for part in parts])
    is_alone &= sliding_window_view(even, 4)[places - 2].all(axis=1)
    # A counter that overflows may flicker from one end of its range to the other.
    is_within = (low <= values[places]) & (values[places] <= high)
    is_alone &= ~(is_within & (np.abs(sizes) > 0.5 * (high - low)))
    return places[is_alone], sizes[is_alone]


def _is_calm_around(
    values: FloatArray, places: NDArray[np.int64], sizes: FloatArray
) -> NDArray[np.bool_]:
    """Whether the motion around each place bends little, but for a spike of this size."""
    bends = np.diff(sliding_window_view(values, 2 * _AROUND + 1)[places - _AROUND], 2)
    bends = (bends - np.median(bends, axis=1)[:, None]) / np.abs(sizes)[:, None]
    # Of a spike they are as 1, -2, 1; of a velocity that jumps they have one sign.
    middle = _AROUND - 1  # the sample's own
    bends[:, middle - 1 : middle + 2] -= np.outer(np.sign(sizes), [1.0, -2.0, 1.0])
    return ~(np.abs(bends).max(axis=1) > _CALM)
