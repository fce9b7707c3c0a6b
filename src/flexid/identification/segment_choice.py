"""How long the segments of the prediction error are: chosen by the free run over held-out data.

Long segments tell more, for what a coefficient does adds up over a segment; but what the model
lacks adds up too. Of the lengths whose free runs are about equally good, the longest is taken. How
far the coefficients move from length to length beyond noise is evidence of its own: those of a
right model do not.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from flexid.estimators.prediction_error import PredictionErrorFit
from flexid.estimators.samples import FloatArray
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
    best: Trial, cuts: Sequence[Pieces], durations: Sequence[float], progress: Progress
) -> list[Trial]:
    """Fit and run a candidate with segments of several lengths, and without any.

    Lengths that cut the record into the same segments are tried once.
    """
    trials = [attempt(replace(best.candidate, segment_duration=0.0), cuts)]
    counts = set()
    for duration in durations:
        count = sum(
            max(1, round(start * piece.sample_time / duration))
            for piece, start in zip(cuts[0].recorded, cuts[0].starts, strict=True)
        )
        if count in counts:
            continue
        counts.add(count)
        if duration == best.candidate.segment_duration:
            trials.append(best)
            continue
        progress(f"segments of {duration:g} s")
        trials.append(attempt(replace(best.candidate, segment_duration=duration), cuts))
    return trials


def best_segments(trials: Sequence[Trial]) -> Trial:
    """The trial to follow: least squares itself only where no prediction error does as well.

    Of the lengths about equally good, the longest: its predicted variance is no guide, for what the
    model lacks makes the residuals of short segments small and those of long ones large.
    """
    least = min(trial.error for trial in trials)
    equal = [
        trial
        for trial in trials
        if trial.finish is not None and trial.error <= least * (1 + ABOUT_EQUAL)
    ]
    if not equal:
        return min(trials, key=lambda trial: trial.error)
    return max(equal, key=lambda trial: trial.candidate.segment_duration)


def segment_evidence(trials: Sequence[Trial]) -> tuple[SegmentEvidence, ...]:
    """What the trials say, for the record."""
    return tuple(
        SegmentEvidence(
            trial.candidate.segment_duration,
            trial.error,
            trial.finish is not None or trial.candidate.segment_duration == 0,
        )
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
    names = chosen.finish.fit.names
    excess = np.zeros(len(names))
    for trial in trials:
        if trial.finish is not None and trial.finish.fit.names == names:
            moved, noise = _distance(chosen.finish.fit, trial.finish.fit)
            beyond = moved - _NOISE_DEVIATIONS * noise
            excess = np.fmax(excess, np.where(np.isfinite(beyond), beyond, 0.0))
    return dict(zip(names, map(float, excess), strict=True))


def _distance(one: PredictionErrorFit, other: PredictionErrorFit) -> tuple[FloatArray, FloatArray]:
    """How far two fits are apart, and the standard deviation that noise would give that."""
    return np.abs(one.values - other.values), np.sqrt(_variances(one) + _variances(other))


def _variances(fit: PredictionErrorFit) -> FloatArray:
    """The larger of both variances; that of the blocks is missing where they are too few."""
    blocks = np.diag(fit.covariance)
    return np.fmax(np.diag(fit.gauss_newton_covariance), np.where(np.isfinite(blocks), blocks, 0.0))
