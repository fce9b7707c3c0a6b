"""How well the model alone predicts a stretch that was kept out of the fit, and for how long.

The state at the start of a prediction is taken from the data before it, half a second unless told
otherwise: the model is fitted to that with its initial states as the only unknowns, or an observer
follows it; and the model runs on from there. Nothing of the stretch itself but the input is used.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.samples import Samples
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.estimators.segments import FEWEST_SAMPLES, Segments, divide
from flexid.identification.full_model.model import Data, Fitted, M
from flexid.identification.preparation.arm import ElasticArm
from flexid.identification.preparation.joint import Joint
from flexid.identification.vocabulary.evidence import FreeRun, Validation
from flexid.symmetric import pseudo_inverse

_MOST_STEPS = 10
_NULL = 1e-9  # of the largest eigenvalue
_CONVERGED = 1e-6  # relative fall of the sum of squares that the last step promises


def following_states(
    model: SegmentedMotion,
    values: FloatArray,  # (k,)
    windows: Segments,
) -> FloatArray:
    """First states for which a model follows its windows best, its coefficients given.

    Returns shape (n_windows, n_states).
    """
    problem = replace(model, segments=windows)
    states = problem.start_states
    equations = problem.equations(Point(values, states), "states")
    firsts = problem.first_blocks[:-1]
    share = np.ones((len(windows), 1))  # of a step, that is taken
    for _ in range(_MOST_STEPS):
        normal = np.add.reduceat(equations.normal, firsts, axis=0)
        gradient = np.add.reduceat(equations.gradient, firsts, axis=0)
        scale = np.sqrt(np.einsum("sii->si", normal))
        scale = np.where(scale > 0.0, scale, 1.0)
        inverse = pseudo_inverse(normal / (scale[:, :, None] * scale[:, None, :]), _NULL)
        step = np.einsum("sij,sj->si", inverse, gradient / scale) / scale
        runs = ~equations.diverged
        if np.sum((step * gradient)[runs]) <= _CONVERGED * np.sum(equations.costs[runs]):
            return states + step
        trial = problem.equations(Point(values, states + share * step), "states")
        # One that a step leads astray, where a side sticks or is jolted, keeps no other back.
        better = (trial.costs < equations.costs)[:, None]
        states = np.where(better, states + share * step, states)
        share = np.where(better, 1.0, 0.5 * share)
        equations = trial if better.all() else problem.equations(Point(values, states), "states")
    return states


Follower = Callable[
    [SegmentedMotion, FloatArray, Segments, NDArray[np.int64]], tuple[SegmentedMotion, FloatArray]
]
"""Follows stretches for so many samples each, and predicts what comes after.

Takes a model, its values, the stretches and the numbers of samples; returns a motion over the
stretches and their first states.
"""


Channels = Joint | ElasticArm
"""What a free run is compared in."""

HORIZONS = (0.05, 0.2, 1.0, 5.0)
"""Seconds after which predictions begin again."""

_WARM_UP = 0.5  # s of data before a prediction from which its first state is taken
_SMALLEST, _LARGEST = 1e-9, 1e4  # per cent of the motion, errors that are compared
_REST = 0.05  # root mean square of held-out motion over that of fitted motion, below which it rests


def validate(
    fitted: Fitted[M],
    data: Data,
    starts: Sequence[int],
    horizons: Sequence[float] = HORIZONS,
    follow: Follower | None = None,
    warm_up: float = _WARM_UP,  # s
) -> Validation:
    """Predict the held-out end of each recording.

    With fit −inf per cent in every channel if the free run diverges, and NaN in a channel that
    hardly moves in the held-out stretches, where a fit would test nothing.
    """
    joint, problem = fitted.structure.joint, fitted.problem
    rest = (data.samples, starts, horizons, follow, warm_up)
    return validate_with(joint, problem, fitted.values, *rest)


def validate_with(
    joint: Channels,
    problem: SegmentedMotion,
    values: FloatArray,  # (k,)
    samples: Sequence[Samples],
    starts: Sequence[int],
    horizons: Sequence[float] = HORIZONS,
    follow: Follower | None = None,
    warm_up: float = _WARM_UP,  # s
) -> Validation:
    """Predict the held-out end of each recording with given values, wherever they come from.

    An observer knows where a motion is now, its disturbances among it, but forgets what was half a
    second ago. So `follow` is for predictions that are no longer; a longer one begins from the
    state that fits that time best.
    """
    spreads = _spreads(joint, samples, starts)
    ends = [[start] for start in starts]
    rest = (joint, problem, values, samples)
    runs = _predictions(*rest, ends, np.inf, warm_up, from_fitted_states)
    fits = {}
    for horizon in horizons:
        origins = [
            _origins(len(recording), start, recording.sample_time, horizon, warm_up)
            for recording, start in zip(samples, starts, strict=True)
        ]
        if any(origins):
            begin = follow if follow and horizon <= warm_up else from_fitted_states
            predicted = _predictions(*rest, origins, horizon, warm_up, begin)
            fits[horizon] = percent_explained(joint, predicted, spreads)
    return Validation(percent_explained(joint, runs, spreads), tuple(runs), fits)


def misprediction(validation: Validation) -> float:
    """Mean logarithm of the errors over horizons and channels: what a better model has less of."""
    fits = [f for by_channel in validation.horizons.values() for f in by_channel.values()]
    fits += list(validation.fit_percent.values())
    errors = np.array([100.0 - fit for fit in fits if not np.isnan(fit)])
    return float(np.mean(np.log(np.clip(errors, _SMALLEST, _LARGEST)))) if len(errors) else 0.0


def _origins(
    length: int, start: int, sample_time: float, horizon: float, warm_up: float
) -> list[int]:
    """First samples of predictions that end before the next one needs its data."""
    span = round(horizon / sample_time)
    # Windows that are fitted to must not overlap with what another one predicts.
    pitch = span + _samples_of(warm_up, sample_time)
    return list(range(start, length - span, pitch))


def _samples_of(warm_up: float, sample_time: float) -> int:
    return max(FEWEST_SAMPLES, round(warm_up / sample_time))


def _predictions(
    joint: Channels,
    model: SegmentedMotion,
    values: FloatArray,
    recordings: Sequence[Samples],
    origins: Sequence[Sequence[int]],
    horizon: float,
    warm_up: float,
    follow: Follower,
) -> list[FreeRun]:
    """Predicted motion from each origin on, for a horizon in s or to the end of its recording."""
    duration = sum(len(own) * own.sample_time for own in recordings)
    whole = divide(recordings, duration)  # one segment for each recording
    firsts, warm, total, sources = [], [], [], []
    for recording, (samples, own) in enumerate(zip(recordings, origins, strict=True)):
        offset = int(whole.recording_starts[recording])
        for origin in own:
            first = max(0, origin - _samples_of(warm_up, samples.sample_time))
            last = len(samples)
            if np.isfinite(horizon):
                last = min(last, origin + round(horizon / samples.sample_time))
            firsts.append(offset + first)
            warm.append(origin - first)
            total.append(last - first)
            sources.append(recording)
    windows = _windows(whole, firsts, total, sources)
    return predicted_runs(joint, model, values, windows, np.array(warm, dtype=np.int64), follow)


def predicted_runs(
    joint: Channels,
    model: SegmentedMotion,
    values: FloatArray,  # (k,)
    windows: Segments,
    warm: NDArray[np.int64],  # (n_windows,): samples that are followed
    follow: Follower,
) -> list[FreeRun]:
    """Predicted motion over the rest of each window, whose first samples are followed."""
    problem, states = follow(model, values, windows, warm)
    equations = problem.equations(Point(values, states), "nothing")
    measured = problem.on_time(values)
    runs = []
    for s, (first, skipped, length) in enumerate(
        zip(windows.starts, warm, windows.lengths, strict=True)
    ):
        part = slice(first + skipped, first + length)
        inputs = windows.inputs[part]
        channels = joint.channels_of(measured[part], inputs)
        predicted = joint.channels_of(measured[part] - equations.residuals[part], inputs)
        if equations.diverged[s]:
            predicted = np.full_like(channels, np.inf)
        after = windows.sample_times[s] * np.arange(skipped, length)
        runs.append(FreeRun(windows.start_times[s] + after, channels, predicted))
    return runs


def from_fitted_states(
    model: SegmentedMotion, values: FloatArray, windows: Segments, warm: NDArray[np.int64]
) -> tuple[SegmentedMotion, FloatArray]:
    """The model over windows, from the states with which it follows their first samples best."""
    states = following_states(model, values, replace(windows, lengths=warm))
    return replace(model, segments=windows), states


def _windows(
    whole: Segments, firsts: Sequence[int], spans: Sequence[int], recordings: Sequence[int]
) -> Segments:
    """Stretches of recordings as segments; `whole` has one segment for each recording."""
    own, starts = np.array(recordings, dtype=np.int64), np.array(firsts, dtype=np.int64)
    after = whole.sample_times[own] * (starts - whole.recording_starts[own])
    return replace(
        whole,
        starts=starts,
        lengths=np.array(spans, dtype=np.int64),
        sample_times=whole.sample_times[own],
        start_times=whole.start_times[own] + after,
        recordings=own,
    )


def _spreads(joint: Channels, samples: Sequence[Samples], starts: Sequence[int]) -> FloatArray:
    """Root mean square of the held-out motion about its mean, per channel; NaN where it rests."""
    every = [joint.channels_of(recording.positions, recording.inputs) for recording in samples]
    held = _spread([y[start:] for y, start in zip(every, starts, strict=True)])
    fitted = _spread([y[:start] for y, start in zip(every, starts, strict=True)])
    return np.where(held <= _REST * fitted, np.nan, held)


def _spread(stretches: Sequence[FloatArray]) -> FloatArray:
    squares = sum(np.sum((y - y.mean(axis=0)) ** 2, axis=0) for y in stretches)
    return np.sqrt(np.asarray(squares) / sum(map(len, stretches)))


def percent_explained(
    joint: Channels,
    runs: Sequence[FreeRun],
    spreads: FloatArray,  # (n_channels,)
) -> dict[str, float]:
    """Per cent of each channel that runs predict, of root mean squares."""
    squares = sum(np.sum((run.measured - run.simulated) ** 2, axis=0) for run in runs)
    error = np.sqrt(np.asarray(squares) / sum(len(run.time) for run in runs))
    with np.errstate(invalid="ignore"):
        fits = 100.0 * (1.0 - error / spreads)
    return dict(zip(joint.channels, map(float, fits), strict=True))
