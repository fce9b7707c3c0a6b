"""How much of an arm's motion a free run explains that was no part of the fit."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from flexid.arms.disturbed import NEAR_STEPS, DisturbedFit, resonances
from flexid.arms.unusual import FittedArm
from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.samples import Samples
from flexid.estimators.segments import Segments, divide
from flexid.identification.estimation.in_band import observer_following
from flexid.identification.full_model.fitting import Steps, fit_segments
from flexid.identification.structure.validation import (
    Follower,
    from_fitted_states,
    percent_explained,
    predicted_runs,
)

SHARE = 1 / 3
"""Part of each recording, at its end, that is predicted."""

_WINDOW = 2.5  # s that a free run lasts, its start included
_START = 0.2  # part of that from which the first state is taken
_FEW = Steps(0.1, insist=False, iterations=6, most_substeps=30)
_WARM = 0.5  # s that an observer follows before a prediction over a period


def free_run(fitted: FittedArm) -> Mapping[str, float]:
    """Share of each channel, in per cent, over the end of the log, from a fit to its beginning.

    Runs start every 2.5 s; their first states are fitted to their first fifth, which does not
    count.
    """
    first, last = _cut(fitted.data.samples)
    beginning = replace(fitted.data, samples=first, noise=1.0 / fitted.problem.weights)
    try:
        segments = divide(first, fitted.problem.segments.mean_duration)
        values = fit_segments(
            fitted.structure, beginning, segments, fitted.by_name, None, _FEW
        ).values
        windows = divide(last, _WINDOW)
        followed = _START * windows.lengths.astype(np.float64)
    except (ConvergenceError, SettingError):
        return {}
    return _shares(fitted, values, windows, followed, from_fitted_states)


def disturbed_run(disturbed: DisturbedFit) -> tuple[Mapping[str, float], dict[int, float]]:
    """The same where an observer follows the beginning of each run; and over a resonance's period.

    Returns the shares of `free_run`, and for each joint the share of its deflection.
    """
    job, fitted = disturbed.job, disturbed.fitted
    first, _ = _cut(job.data.samples)
    _, last = _cut(fitted.data.samples)
    beginning = replace(job, data=replace(job.data, samples=first)).in_band
    follow = observer_following(beginning.directions, disturbed.best.sizes)
    try:
        values = beginning.with_gains_of(fitted, fitted.by_name, NEAR_STEPS).values

        def shares(duration: float, followed: float) -> dict[str, float]:
            windows = divide(last, duration)
            return _shares(fitted, values, windows, followed / windows.sample_times, follow)

        whole = shares(_WINDOW, _START * _WINDOW)
        periods = {}
        for joint, period in enumerate(
            (2.0 * np.pi / resonances(job.balance, disturbed.values)), 1
        ):
            horizon = float(np.clip(period, 5.0 * last[0].sample_time, _WINDOW - _WARM))
            periods[joint] = shares(_WARM + horizon, _WARM)[f"deflection_{joint}"]
    except (ConvergenceError, SettingError):
        return {}, {}
    return whole, periods


def _cut(recordings: Sequence[Samples]) -> tuple[tuple[Samples, ...], tuple[Samples, ...]]:
    """What each recording begins with, and its end that is predicted."""
    cuts = [round((1.0 - SHARE) * len(recording)) for recording in recordings]
    own = list(zip(recordings, cuts, strict=True))
    return tuple(r.window(0, cut) for r, cut in own), tuple(r.window(cut, len(r)) for r, cut in own)


def _shares(
    fitted: FittedArm,
    values: FloatArray,  # (k,)
    windows: Segments,
    followed: FloatArray,  # (n_windows,): samples of each
    follow: Follower,
) -> dict[str, float]:
    """Per cent of each channel that is predicted over the rest of windows."""
    arm, warm = fitted.structure.joint, np.maximum(followed.astype(np.int64), 2)
    runs = predicted_runs(arm, fitted.problem, values, windows, warm, follow)
    spreads = np.concatenate([run.measured for run in runs]).std(axis=0)
    return percent_explained(arm, runs, np.where(spreads > 0.0, spreads, np.nan))
