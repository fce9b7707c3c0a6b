"""How long the segments of the prediction error are: chosen by the free run over held-out data.

Long segments tell more, for what a coefficient does adds up over a segment; but what the model
lacks adds up too. Of the lengths whose free runs are about equally good, the one with the least
predicted variance is taken. How far the coefficients move from length to length beyond noise is
evidence of its own: those of a right model do not.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from flexid.identification.candidate import Trial, attempt
from flexid.identification.preparation import Pieces
from flexid.identification.result import SegmentEvidence

DURATIONS = (0.25, 0.5, 1.0, 2.0, 5.0, 10.0)
"""Lengths of a segment in s that are tried."""

ABOUT_EQUAL = 0.01
"""Excess of the free run's error that counts as about equally good."""

_NOISE_DEVIATIONS = 2.0  # by which coefficients may differ between lengths for no reason

Progress = Callable[[str], None]


def try_segments(
    best: Trial, pieces: Pieces, durations: Sequence[float], progress: Progress
) -> list[Trial]:
    """Fit and run a candidate with segments of several lengths, and without any.

    Lengths that cut the record into the same segments are tried once.
    """
    trials = [attempt(replace(best.candidate, segment_duration=0.0), pieces)]
    counts = set()
    for duration in durations:
        count = sum(
            max(1, round(start * piece.sample_time / duration))
            for piece, start in zip(pieces.recorded, pieces.starts, strict=True)
        )
        if count in counts:
            continue
        counts.add(count)
        progress(f"segments of {duration:g} s")
        trials.append(attempt(replace(best.candidate, segment_duration=duration), pieces))
    return trials


def best_segments(trials: Sequence[Trial]) -> Trial:
    """The trial to follow: least squares itself only where no prediction error does as well."""
    converged = [trial for trial in trials if trial.finish is not None]
    least = min(trial.error for trial in trials)
    equal = [trial for trial in converged if trial.error <= least * (1 + ABOUT_EQUAL)]
    if not equal:
        return min(trials, key=lambda trial: trial.error)
    return min(equal, key=_log_variance)


def segment_evidence(trials: Sequence[Trial]) -> tuple[SegmentEvidence, ...]:
    """What the trials say, for the record."""
    return tuple(
        SegmentEvidence(trial.candidate.segment_duration, trial.error, _log_variance(trial))
        for trial in trials
    )


def segment_shifts(chosen: Trial, trials: Sequence[Trial]) -> dict[str, float]:
    """How far each coefficient moves with the length of the segments, beyond noise.

    Returns
    -------
    dict of str to float
        In the coefficients' units; 0 where noise explains it all. Empty for least squares.
    """
    if chosen.finish is None:
        return {}
    values, variances = chosen.finish.fit.values, np.diag(chosen.finish.fit.gauss_newton_covariance)
    excess = np.zeros(len(values))
    for trial in trials:
        if trial.finish is None or trial.finish.fit.names != chosen.finish.fit.names:
            continue
        noise = np.sqrt(variances + np.diag(trial.finish.fit.gauss_newton_covariance))
        beyond = np.abs(trial.finish.fit.values - values) - _NOISE_DEVIATIONS * noise
        excess = np.fmax(excess, np.where(np.isfinite(beyond), beyond, 0.0))
    return dict(zip(chosen.finish.fit.names, map(float, excess), strict=True))


def _log_variance(trial: Trial) -> float:
    if trial.finish is None:
        return np.nan
    variances = np.diag(trial.finish.fit.gauss_newton_covariance)
    known = np.isfinite(variances) & (variances > 0) & (trial.finish.fit.values != 0)
    relative = variances[known] / trial.finish.fit.values[known] ** 2
    return float(np.mean(np.log(relative))) if known.any() else np.inf
