"""Samples that were lost: in a time that was counted without them, or missing by the stamps.

If the time was counted from the remaining samples, all positions advance there by whole steps too
many. Two models predict each step from the steps around it, with and without lost samples. They
are fitted to the log by least squares, and compared by their likelihoods for all positions
together.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.special import expit, logit

from flexid.arrays import FloatArray
from flexid.recording.sampling import EVEN, MOST_GAPS, MOST_JITTER, ROUNDED

_NEAR = 4  # neighbouring steps on either side
_MOST_LOST = 3  # samples in one place; more are treated as a gap
CLEAR = 10.0  # threshold of the log-likelihood ratio: a chance of 1 in 20 000
_LEAST_SHARE = 4.0  # least number of places with lost samples over those with a step too few
_LEAST_SPEED = 0.3  # median speed at lost samples over the mean: losses occur at any speed
_LEAST_EXPLAINED = 0.75  # share of places whose error a loss explains completely
_LEFT_OVER = 0.05  # share of a squared error that a loss may leave, in addition to chance
_BY_CHANCE = 10.0  # squared error over its variance
_NEARBY = 200  # steps of a neighbourhood, most of which are without a loss
_PASSES = 8  # over the log: a loss hides others nearby
_ROUNDS = 40  # for the rate of losses: where nine of ten are hidden, 2 % remain
_TRIMS, _TRIMMED = 4, 5.0  # rounds of robust fitting; outliers in standard deviations
_FEWEST_WINDOWS = 60  # for each channel, several times the number of weights
_MOST_WINDOWS = 5_000  # for a fit: more make it slower, but no better
_NEGLIGIBLE = 1e-10  # relative singular values, and errors over steps, that count as zero
FEWEST_PLACES = 3  # with lost samples: fewer hardly change an estimate
_SHORTEST_PART = 2.0  # s between losses in the time stamps: longer parts become recordings


def lost_samples(positions: list[FloatArray], time: FloatArray) -> NDArray[np.int64]:
    """Return the number of samples lost after each, shape (n - 1,), judged by the positions."""
    none = np.zeros(len(time) - 1, dtype=np.int64)
    steps = np.diff(time)
    is_counted = np.ptp(steps) <= EVEN * np.median(steps)
    if not positions or len(time) < _FEWEST_WINDOWS * len(positions) or not is_counted:
        return none
    seen = np.column_stack(positions)
    lost = none
    for _ in range(_PASSES):
        more, ratio = _likeliest_losses(seen, lost)
        clear = ratio > CLEAR
        lossy_places = np.count_nonzero(lost) + np.count_nonzero(clear & (more > 0))
        # A motion that itself has uneven steps also has too short ones.
        least = max(FEWEST_PLACES, _LEAST_SHARE * np.count_nonzero(clear & (more < 0)))
        if lossy_places < least:
            return none
        # A loss disturbs the windows around it, so the clearest in a neighbourhood comes first.
        around = np.pad(ratio, _NEAR, mode="edge")
        clearest = ratio >= sliding_window_view(around, 2 * _NEAR + 1).max(axis=1)
        added = np.where(clear & clearest & (more > 0), more, 0)
        if not added.any():
            break
        lost = lost + added
        if _windows_without(lost) < _FEWEST_WINDOWS * len(positions):
            return none
    explained = lost * _explained(seen, lost)
    # Friction disturbs a motion at reversals only, but samples are lost at any speed.
    speeds = np.abs(np.diff(seen, axis=0))
    speeds = np.mean(speeds / (speeds.mean(axis=0) + np.finfo(float).tiny), axis=1)
    if explained.any() and not np.median(speeds[explained > 0]) > _LEAST_SPEED:
        return none
    enough = np.count_nonzero(explained) >= _LEAST_EXPLAINED * np.count_nonzero(lost)
    return explained if enough else none


def with_hidden_losses(positions: list[FloatArray], lost: NDArray[np.int64]) -> NDArray[np.int64]:
    """Add losses that noise hides, shape (n - 1,), as many as the log's rate makes likely.

    The rate and the probability of a loss at each step follow from each other, by Bayes' rule. A
    sample is put where the sum of these probabilities passes the next whole number and a half. An
    error that a loss does not explain is none, as in `_explained`.
    """
    seen, count = np.column_stack(positions), np.count_nonzero(lost)
    steps, whole, firsts = _steps(seen, lost)
    tested = np.flatnonzero((firsts >= _NEAR) & (firsts < len(steps) - _NEAR - 1) & (lost == 0))
    neighbours, own = _step_windows(steps, firsts[tested], 0)
    none, one = (_Interpolator.fitted(steps, whole, number) for number in (0, 1))
    usual = _local_inflation(none.squares(neighbours, own), steps.shape[1])
    ratio = (none.nll(neighbours, own) - one.nll(neighbours, own)) / usual
    ratio[one.squares(neighbours, own) > _BY_CHANCE * usual] = -np.inf
    chance = np.zeros(len(tested))
    for _ in range(_ROUNDS):
        chance = expit(ratio + logit((count + chance.sum()) / len(lost)))
    whole_ones = np.floor(np.cumsum(chance) + 0.5).astype(np.int64)
    found = lost.copy()
    found[tested] += np.diff(whole_ones, prepend=0)
    return found


def _windows_without(lost: NDArray[np.int64]) -> int:
    """Number of windows without lost samples, of the greatest length that a fit uses."""
    gone = np.cumsum(np.concatenate(([0], lost > 0)))
    length = 2 * _NEAR + _MOST_LOST + 1
    return int(np.count_nonzero(gone[length:] == gone[:-length]))


def lost_by_the_clock(time: FloatArray) -> NDArray[np.int64]:
    """Return the number of samples missing by the stamps, shape (n - 1,); 0 if losses are rare."""
    steps = np.diff(time) / np.median(np.diff(time))
    whole = np.rint(steps)
    is_short = whole <= _MOST_LOST + 1
    off = np.abs(steps - whole)
    lost = np.where(is_short & (whole >= 2) & (off <= MOST_JITTER), whole - 1, 0).astype(np.int64)
    if np.mean(is_short & (off > 2.0 * MOST_JITTER)) > MOST_GAPS:
        return np.zeros_like(lost)  # late stamps also double some steps
    places = np.count_nonzero(lost)
    # Few gaps are cut, which is more accurate; but many short pieces show no slow motion.
    is_often = places >= FEWEST_PLACES and places * _SHORTEST_PART > time[-1] - time[0]
    return lost if is_often and np.mean(lost > 0) <= MOST_GAPS else np.zeros_like(lost)


def even_times(time: FloatArray, positions: list[FloatArray]) -> FloatArray | None:
    """Return even times if double steps come from a coarse clock instead of losses; else None.

    At 970 samples per second in whole milliseconds, every 32nd step is 2 ms. The positions decide.
    If they are inconclusive, double steps that recur evenly count as rounding.
    """
    steps = np.diff(time) / np.median(np.diff(time))
    whole = np.maximum(np.rint(steps), 1.0)
    doubled = whole == 2.0
    if not 0.0 < np.mean(doubled) <= MOST_GAPS or np.abs(steps - whole).max() > EVEN:
        return None
    evidence = evidence_of_losses(np.column_stack(positions), doubled) if positions else 0.0
    if evidence > CLEAR:
        return None
    is_gap = whole > _MOST_LOST + 1
    step = np.diff(time)[~is_gap].mean()
    number = np.cumsum(np.where(is_gap, np.rint(np.diff(time) / step), 1.0))
    counted = _minimax_line(time, np.concatenate(([0.0], number)))
    recurs = np.ptp(time - counted) <= ROUNDED * np.median(np.diff(time))
    is_rounding = recurs and np.count_nonzero(doubled) >= FEWEST_PLACES
    return counted if evidence < -CLEAR or is_rounding else None


def _minimax_line(time: FloatArray, number: FloatArray) -> FloatArray:
    """Minimax fit: the line in the sample number with the least largest distance from `time`."""
    step = (time[-1] - time[0]) / number[-1]
    nearby = step * (1.0 + np.array([-2.0, 2.0]) / number[-1])  # times err by a step at most
    # Imported here because it is slow and rarely needed.
    from scipy.optimize import minimize_scalar

    found: Any = minimize_scalar(
        lambda each: np.ptp(time - each * number), bounds=nearby, options={"xatol": 1e-9 * step}
    )
    off = time - found.x * number
    return found.x * number + 0.5 * (off.min() + off.max())


def evidence_of_losses(positions: FloatArray, suspected: NDArray[np.bool_]) -> float:
    """Log-likelihood ratio of one lost sample in all suspected steps against none."""
    steps = np.diff(positions, axis=0)
    places = np.flatnonzero(suspected)
    places = places[(places >= _NEAR) & (places < len(steps) - _NEAR)]
    if _windows_without(suspected.astype(np.int64)) < _FEWEST_WINDOWS * steps.shape[1]:
        return 0.0
    neighbours, own = _step_windows(steps, places, 0)
    none, one = (_Interpolator.fitted(steps, ~suspected, count) for count in (0, 1))
    each = none.nll(neighbours, own) - one.nll(neighbours, own)
    return float(np.clip(each, -CLEAR, CLEAR).sum())  # limits the influence of a single shock


def all_times(time: FloatArray, lost: NDArray[np.int64], *, is_span: bool) -> FloatArray:
    """Return even times of all samples; either the span of `time` is right, or its step."""
    count = len(time) + int(lost.sum())
    step = (time[-1] - time[0]) / ((count if is_span else len(time)) - 1)
    return time[0] + step * np.arange(count)


def logged_indices(lost: NDArray[np.int64]) -> NDArray[np.int64]:
    """Indices of the logged samples among all, including the lost ones."""
    return np.concatenate(([0], np.cumsum(1 + lost)))


def _likeliest_losses(
    positions: FloatArray, lost: NDArray[np.int64]
) -> tuple[NDArray[np.int64], FloatArray]:
    """Likeliest number of lost samples by step (-1: no motion), and log-likelihood ratio to 0."""
    steps, whole, firsts = _steps(positions, lost)
    tested = np.flatnonzero((firsts >= _NEAR) & (firsts < len(steps) - _NEAR) & (lost == 0))
    plain = _Interpolator.fitted(steps, whole, 0)
    off = plain.squares(*_step_windows(steps, firsts[tested], 0))
    usual = _local_inflation(off, steps.shape[1])
    unlikely = off > 2.0 * CLEAR * usual  # only these can exceed the threshold
    tested, usual = tested[unlikely], usual[unlikely]
    number, ratio = np.zeros_like(lost), np.full(len(lost), -np.inf)
    if len(tested):
        neighbours, own = _step_windows(steps, firsts[tested], 0)
        others = [_Interpolator.fitted(steps, whole, count) for count in range(1, _MOST_LOST + 1)]
        found = [plain.nll(0.0 * neighbours, own)]
        found += [other.nll(neighbours, own) for other in others]
        ratios = plain.nll(neighbours, own) - np.array(found)
        best = np.argmax(ratios, axis=0)
        number[tested] = np.array([-1, *range(1, _MOST_LOST + 1)])[best]
        ratio[tested] = ratios[best, np.arange(len(best))] / usual
    return number, ratio


def _local_inflation(squares: FloatArray, channels: int) -> FloatArray:
    """Local median of squared errors over its expected value, at least 1, as in fast motion."""
    by_chance = channels * (1.0 - 2.0 / (9.0 * channels)) ** 3  # median of chi-squared
    parts = np.array_split(squares, max(1, len(squares) // _NEARBY))
    each = [
        np.full(len(part), max(1.0, np.median(part) / by_chance)) for part in parts if len(part)
    ]
    return np.concatenate(each) if each else np.ones(0)


def _explained(positions: FloatArray, lost: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether losses explain each error almost completely, shape (n - 1,), unlike a shock."""
    steps, whole, firsts = _steps(positions, lost)
    found = np.ones(len(lost), dtype=bool)
    for number in np.unique(lost[lost > 0]).tolist():
        inside = (firsts >= _NEAR) & (firsts < len(steps) - _NEAR - number) & (lost == number)
        neighbours, own = _step_windows(steps, firsts[inside], number)
        lossy = _Interpolator.fitted(steps, whole, number)
        off = lossy.squares(neighbours / (number + 1.0), own)
        found[inside] = lossy.squares(neighbours, own) <= _BY_CHANCE + _LEFT_OVER * off
    return found


@dataclass(frozen=True, eq=False)
class _Interpolator:
    """Prediction of the steps of all positions from the steps around them, fitted to a log."""

    weights: FloatArray  # (2 * _NEAR * channels + 1, channels)
    root: FloatArray  # (channels, channels): Cholesky factor of the covariance of its errors

    @classmethod
    def fitted(cls, steps: FloatArray, whole: NDArray[np.bool_], lost: int) -> "_Interpolator":
        """Fit the prediction of a step over `lost` samples, from windows without losses."""
        last = len(steps) - _NEAR - lost
        count = min(last - _NEAR, _MOST_WINDOWS)
        firsts = np.unique(np.linspace(_NEAR, last - 1, count).astype(np.int64))
        gone = np.cumsum(np.concatenate(([0], ~whole)))
        firsts = firsts[gone[firsts + _NEAR + lost + 1] == gone[firsts - _NEAR]]
        neighbours, sums = _step_windows(steps, firsts, lost)
        weights, kept = np.zeros((neighbours.shape[1], steps.shape[1])), np.full(len(sums), True)
        errors = sums
        for _ in range(_TRIMS):
            weights = np.linalg.lstsq(neighbours[kept], sums[kept], rcond=_NEGLIGIBLE)[0]
            errors = sums - neighbours @ weights
            usual = np.median(np.abs(errors[kept]), axis=0) / 0.6745 + np.finfo(float).tiny
            close = kept & (np.max(np.abs(errors) / usual, axis=1) < _TRIMMED)
            if np.array_equal(close, kept):
                break
            kept = close
        left = errors[kept]
        floor = _NEGLIGIBLE * np.mean(steps**2, axis=0) + np.finfo(float).tiny
        root = np.linalg.cholesky(left.T @ left / max(len(left), 1) + np.diag(floor))
        return cls(weights.astype(np.float64), root.astype(np.float64))

    def nll(self, neighbours: FloatArray, own: FloatArray) -> FloatArray:
        """Return the negative log-likelihood of each step, up to a constant."""
        return 0.5 * self.squares(neighbours, own) + np.sum(np.log(np.diag(self.root)))

    def squares(self, neighbours: FloatArray, own: FloatArray) -> FloatArray:
        """Return the squared Mahalanobis norm of the error of each step, shape (m,)."""
        return np.sum(np.linalg.solve(self.root, (own - neighbours @ self.weights).T) ** 2, axis=0)


def _steps(
    positions: FloatArray, lost: NDArray[np.int64]
) -> tuple[FloatArray, NDArray[np.bool_], NDArray[np.int64]]:
    """Steps with losses interpolated, whether each was logged, and indices of logged ones."""
    kept = logged_indices(lost)
    if lost.any():
        from scipy.interpolate import CubicSpline  # slow to import, rarely needed

        positions = CubicSpline(kept, positions)(np.arange(kept[-1] + 1))
    steps = np.diff(positions, axis=0)
    whole = np.repeat(lost == 0, 1 + lost)
    return steps, whole, kept[:-1]


def _step_windows(
    steps: FloatArray, firsts: NDArray[np.int64], lost: int
) -> tuple[FloatArray, FloatArray]:
    """Regressors (steps on either side and a constant) and the step over `lost` samples."""
    offsets, channels = [*range(-_NEAR, 0), *range(lost + 1, lost + 1 + _NEAR)], steps.shape[1]
    neighbours = np.ones((len(firsts), len(offsets) * channels + 1))
    for place, offset in enumerate(offsets):
        neighbours[:, place * channels : (place + 1) * channels] = steps[firsts + offset]
    own = steps[firsts]
    for offset in range(1, lost + 1):
        own += steps[firsts + offset]
    return neighbours, own
