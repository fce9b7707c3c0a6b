"""Validation: predictions of held-out data over several horizons.

The state at the start of a prediction comes from the data before it, by default half a second. The
model is fitted to these data with its initial states as the only unknowns, or an observer follows
them. From there the model runs freely. Of the predicted data only the input is used.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.normal_equations import scaled_pseudo_inverse
from flexid.estimators.samples import FEWEST_SAMPLES, Samples, Segments, divide
from flexid.estimators.segmented_motion import Point, SegmentedMotion
from flexid.identification.full_model.model import Data, Fitted, M
from flexid.identification.preparation.joint import ElasticArm, Joint
from flexid.identification.vocabulary.evidence import FreeRun, Validation

_MOST_STEPS = 10
_NULL = 1e-9  # of the largest eigenvalue; smaller ones count as zero
_CONVERGED = 1e-4  # relative fall of the sum of squares predicted for the last step


def following_states(
    model: SegmentedMotion,
    values: FloatArray,  # (k,)
    windows: Segments,
) -> FloatArray:
    """Fit the first states of each window, with the coefficients given.

    Returns shape (n_windows, n_states).
    """
    states = replace(model, segments=windows).start_states
    normal, gradient, costs = _equations(model, values, windows, states)
    share = np.ones(len(windows))  # of a step
    seeking = np.arange(len(windows))
    for _ in range(_MOST_STEPS):
        inverse = scaled_pseudo_inverse(normal[seeking], _NULL)
        steps = np.einsum("sij,sj->si", inverse, gradient[seeking])
        promised = np.sum(steps * gradient[seeking], axis=1)
        ends = np.isfinite(costs[seeking]) & (promised <= _CONVERGED * costs[seeking])
        states[seeking[ends]] += steps[ends]
        seeking, steps = seeking[~ends], steps[~ends]
        if not len(seeking):
            break
        trial = states[seeking] + share[seeking, None] * steps
        tried = _equations(model, values, windows.at(seeking), trial)
        # Windows are accepted one by one, so that a jolt in one does not stop the others.
        better = tried[-1] < costs[seeking]
        share[seeking] = np.where(better, 1.0, 0.5 * share[seeking])
        for own, its in zip((states, normal, gradient, costs), (trial, *tried), strict=True):
            own[seeking[better]] = its[better]
    return states


def _equations(
    model: SegmentedMotion, values: FloatArray, windows: Segments, states: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return normal matrices and gradients of the first states, by window, and costs."""
    problem = replace(model, segments=windows)
    firsts = problem.first_blocks[:-1]
    found = problem.equations(Point(values, states), "states")
    normal, gradient = (np.add.reduceat(own, firsts) for own in (found.normal, found.gradient))
    return normal, gradient, found.costs


Follower = Callable[
    [SegmentedMotion, FloatArray, Segments, NDArray[np.int64]], tuple[SegmentedMotion, FloatArray]
]
"""Function that follows the first samples of each window and predicts the others.

It takes a model, its values, the windows and the number of samples to follow in each. It returns a
motion over the windows and their first states.
"""


Channels = Joint | ElasticArm
"""Models that define the channels of a free run."""

HORIZONS = (0.05, 0.2, 1.0, 5.0)
"""Lengths of predictions in s."""

_WARM_UP = 0.5  # s of data before a prediction, for its first state
_ENOUGH = 20_000  # most samples of a recording that are predicted, for each horizon
_SMALLEST, _LARGEST = 1e-9, 1e4  # limits of compared errors, in per cent of the motion
_REST = 0.05  # root mean square of held-out over fitted motion, below which a channel rests


def validate(
    fitted: Fitted[M],
    data: Data,
    starts: Sequence[int],
    horizons: Sequence[float] = HORIZONS,
    follow: Follower | None = None,
    warm_up: float = _WARM_UP,  # s
) -> Validation:
    """Predict the held-out end of each recording.

    The fit is −inf per cent in every channel if the free run diverges. It is NaN in a channel that
    hardly moves in the held-out ends, where it would test nothing.
    """
    joint, problem = fitted.structure.joint, fitted.problem
    if problem.unknowns.groups != data.groups:  # it was fitted to pieces of the recordings
        problem = replace(problem, unknowns=replace(problem.unknowns, groups=data.groups))
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
    """Predict the held-out end of each recording with given values.

    An observer knows the present state with its disturbances, but its memory is short. So `follow`
    is used for horizons up to `warm_up`. Longer predictions begin from states fitted to the data
    before them.
    """
    spreads = _spreads(joint, samples, starts)
    windows = _windows(samples, starts, tuple(dict.fromkeys((np.inf, *horizons))), warm_up)
    observed = windows.horizons <= (warm_up if follow else 0.0)
    fitted = windows.those(~observed)
    _, states = from_fitted_states(problem, values, fitted.segments, fitted.warm)
    runs: dict[float, list[FreeRun]] = {}
    for horizon in (np.inf, *horizons):
        own = windows.those(windows.horizons == horizon)
        if not len(own.segments):
            continue
        motion = replace(problem, segments=own.segments)
        first = states[fitted.horizons == horizon]
        if follow and horizon <= warm_up:
            motion, first = follow(problem, values, own.segments, own.warm)
        runs[horizon] = _predicted(joint, motion, Point(values, first), own.warm)
    fits = {horizon: percent_explained(joint, each, spreads) for horizon, each in runs.items()}
    return Validation(fits.pop(np.inf), tuple(runs[np.inf]), fits)


def misprediction(validation: Validation) -> float:
    """Return the mean logarithm of the errors over horizons and channels; less is better."""
    fits = [f for by_channel in validation.horizons.values() for f in by_channel.values()]
    fits += list(validation.fit_percent.values())
    errors = np.array([100.0 - fit for fit in fits if not np.isnan(fit)])
    return float(np.mean(np.log(np.clip(errors, _SMALLEST, _LARGEST)))) if len(errors) else 0.0


@dataclass(frozen=True, eq=False)
class _Windows:
    """Windows of recordings whose first samples are followed and the others predicted."""

    segments: Segments  # in the order of the recordings
    warm: NDArray[np.int64]  # (n_windows,): number of samples that are followed
    horizons: FloatArray  # (n_windows,): predicted time in s

    def those(self, chosen: NDArray[np.bool_]) -> "_Windows":
        """Return the chosen windows."""
        return _Windows(self.segments.at(chosen), self.warm[chosen], self.horizons[chosen])


def _windows(
    recordings: Sequence[Samples],
    starts: Sequence[int],
    horizons: Sequence[float],  # in s, infinite up to the end of a recording
    warm_up: float,  # in s
) -> _Windows:
    """Return consecutive windows of each horizon, or some of them, evenly spread."""
    rows = []
    for place, (samples, start) in enumerate(zip(recordings, starts, strict=True)):
        warm = max(FEWEST_SAMPLES, round(warm_up / samples.sample_time))
        for horizon in horizons:
            span, origins = len(samples) - start, [start]
            if np.isfinite(horizon):
                span = round(horizon / samples.sample_time)
                if span == 0:
                    continue  # shorter than a sample time
                # Followed samples must not overlap with predicted samples of another window.
                origins = list(range(start, len(samples) - span, span + warm))
                origins = origins[:: len(origins) * (span + warm) // _ENOUGH + 1]
            for origin in origins:
                first = max(0, origin - warm)
                rows.append((place, first, origin - first, origin - first + span, horizon))
    table = np.array(rows)
    own, firsts, warms, lengths = table[:, :-1].astype(np.int64).T
    whole = divide(recordings, sum(len(each) * each.sample_time for each in recordings))
    segments = replace(
        whole,
        starts=whole.recording_starts[own] + firsts,
        lengths=lengths,
        sample_times=whole.sample_times[own],
        start_times=whole.start_times[own] + whole.sample_times[own] * firsts,
        recordings=own,
    )
    return _Windows(segments, warms, table[:, -1])


def _predicted(
    joint: Channels, motion: SegmentedMotion, point: Point, warm: NDArray[np.int64]
) -> list[FreeRun]:
    """Return measured and predicted channels of each window after its followed samples."""
    equations = motion.equations(point, "nothing")
    measured, windows = motion.on_time(point.values), motion.segments
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
    """Return the model over windows, with first states fitted to their first samples."""
    states = following_states(model, values, replace(windows, lengths=warm))
    return replace(model, segments=windows), states


def _spreads(joint: Channels, samples: Sequence[Samples], starts: Sequence[int]) -> FloatArray:
    """Return the held-out motion's standard deviation, by channel; NaN if a channel rests."""
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
    """Return the fit in per cent of each channel, from root mean squares."""
    squares = sum(np.sum((run.measured - run.simulated) ** 2, axis=0) for run in runs)
    error = np.sqrt(np.asarray(squares) / sum(len(run.time) for run in runs))
    with np.errstate(invalid="ignore"):
        fits = 100.0 * (1.0 - error / spreads)
    return dict(zip(joint.channels, map(float, fits), strict=True))
