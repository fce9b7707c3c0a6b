"""How well the model alone predicts a stretch that was kept out of the fit, and for how long.

The state at the start of a prediction is taken from the data before it, half a second unless told
otherwise: the model is fitted to that with its initial states as the only unknowns, or an observer
follows it; and the model runs on from there. Nothing of the stretch itself but the input is used.
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
_NULL = 1e-9  # of the largest eigenvalue
_CONVERGED = 1e-4  # relative fall of the sum of squares that the last step promises


def following_states(
    model: SegmentedMotion,
    values: FloatArray,  # (k,)
    windows: Segments,
) -> FloatArray:
    """First states for which a model follows its windows best, its coefficients given.

    Returns shape (n_windows, n_states).
    """
    states = replace(model, segments=windows).start_states
    normal, gradient, costs = _equations(model, values, windows, states)
    share = np.ones(len(windows))  # of a step, that is taken
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
        # One that a step leads astray, where a side sticks or is jolted, keeps no other back.
        better = tried[-1] < costs[seeking]
        share[seeking] = np.where(better, 1.0, 0.5 * share[seeking])
        for own, its in zip((states, normal, gradient, costs), (trial, *tried), strict=True):
            own[seeking[better]] = its[better]
    return states


def _equations(
    model: SegmentedMotion, values: FloatArray, windows: Segments, states: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Normal matrices and gradients of the first states, window by window, and costs."""
    problem = replace(model, segments=windows)
    firsts = problem.first_blocks[:-1]
    found = problem.equations(Point(values, states), "states")
    normal, gradient = (np.add.reduceat(own, firsts) for own in (found.normal, found.gradient))
    return normal, gradient, found.costs


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
_ENOUGH = 20_000  # samples of a recording, in as many windows as are needed, for each horizon
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
    """Mean logarithm of the errors over horizons and channels: what a better model has less of."""
    fits = [f for by_channel in validation.horizons.values() for f in by_channel.values()]
    fits += list(validation.fit_percent.values())
    errors = np.array([100.0 - fit for fit in fits if not np.isnan(fit)])
    return float(np.mean(np.log(np.clip(errors, _SMALLEST, _LARGEST)))) if len(errors) else 0.0


@dataclass(frozen=True, eq=False)
class _Windows:
    """Stretches of recordings whose first samples are followed and the others predicted."""

    segments: Segments  # in the order of the recordings
    warm: NDArray[np.int64]  # (n_windows,): samples that are followed
    horizons: FloatArray  # (n_windows,): seconds that are predicted

    def those(self, chosen: NDArray[np.bool_]) -> "_Windows":
        """Some of them."""
        return _Windows(self.segments.at(chosen), self.warm[chosen], self.horizons[chosen])


def _windows(
    recordings: Sequence[Samples],
    starts: Sequence[int],
    horizons: Sequence[float],  # in s, infinite for what runs to the end of its recording
    warm_up: float,  # in s
) -> _Windows:
    """Windows that begin again after each horizon, or some of them, spread evenly."""
    rows = []
    for place, (samples, start) in enumerate(zip(recordings, starts, strict=True)):
        warm = max(FEWEST_SAMPLES, round(warm_up / samples.sample_time))
        for horizon in horizons:
            span, origins = len(samples) - start, [start]
            if np.isfinite(horizon):
                span = round(horizon / samples.sample_time)
                if span == 0:
                    continue  # shorter than a sample time
                # What is followed must not overlap with what another window predicts.
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
    """Predicted motion over the rest of each window, whose first samples are followed."""
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
    """The model over windows, from the states with which it follows their first samples best."""
    states = following_states(model, values, replace(windows, lengths=warm))
    return replace(model, segments=windows), states


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
