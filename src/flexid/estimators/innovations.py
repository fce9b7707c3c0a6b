"""Innovations: the motion of a disturbed model, predicted sample by sample."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import Minimum, minimise
from flexid.estimators.segmented_motion import RESTING, Observer, Point, SegmentedMotion
from flexid.estimators.steady_gains import (
    WORST,
    Sizes,
    cost_by_spectra,
    steady_gains,
    transition_of,
)

_ROUNDS = (4, 2)  # of sizes and coefficients in turn, from afar and from values nearly right
STEPS = (8, 30)  # of Gauss and Newton in each, and in the last
_SEARCHES = 3  # of the sizes by their spectra, in each round
_ITERATIONS = 30  # of each of these
_NO_FALL = 1.0  # of the cost, in an iteration that is the last one
_SEARCHED = 10.0  # of the cost, that a search brings at least where another one follows
_FINE = 0.03  # standard deviations, of a step that ends an iteration
_FIRST_SHARE = 0.05  # of its row's acceleration, that a disturbance has to begin with
_RANGES = (1e-2, 1e2)  # of a sensor's noise, over that of its signal's short differences
_SHARES = (1e-4, 2.0)  # of a disturbance, over its row's acceleration


@dataclass(frozen=True, eq=False)
class Innovations:
    """A disturbed model fitted to a log."""

    problem: SegmentedMotion  # with its observer
    minimum: Minimum  # where the fit ended
    sizes: Sizes  # of noise and disturbances
    cost: float  # twice the negative logarithm of the likelihood, but for a constant


# What a model lacks acts like a disturbance e of each row, e' = -κ e + white noise of mean square
# σ², and sensors have white noise. Kalman's observer follows; its innovations are white if sizes
# and rates are right, which are those of greatest likelihood (Ljung, System Identification, ch. 4).
def fit_innovations(
    problem: SegmentedMotion,
    point: Point,
    directions: FloatArray,  # (n_samples, n_rows)
    slowest: float,  # in 1/s
    sizes: Sizes | None = None,
    steps: tuple[int, int] = STEPS,
) -> Innovations:
    """Fit coefficients, with gains held, and sizes of noise and disturbances in turn."""
    first = _first_sizes(problem, slowest)
    bounds = _bounds(first, float(problem.segments.sample_times.max()), slowest)
    near = sizes is not None
    sizes = first if sizes is None else sizes
    found: Innovations | None = None
    rounds = _ROUNDS[near]
    for turn in range(rounds):
        observing = _Observing.of(problem, point, directions)
        # Initial states come first, with the coefficients: what they leave passes for noise.
        if turn:
            sizes = observing.likeliest(sizes, bounds)
        seen = observing.with_sizes(sizes)
        if seen.motion is None:
            raise ConvergenceError(
                "prediction error", "the disturbed motion diverges from the starting values"
            )
        minimum = minimise(
            seen.motion, point, _FINE, insist=False, iterations=steps[turn == rounds - 1]
        )
        point = minimum.point
        found = Innovations(seen.motion, minimum, sizes, minimum.equations.cost + seen.entropy)
    assert found is not None
    return found


def first_cost(
    problem: SegmentedMotion,
    point: Point,
    directions: FloatArray,  # (n_samples, n_rows)
    slowest: float,  # in 1/s
) -> float:
    """Twice the negative logarithm of the likelihood of a point, with sizes to begin with."""
    sizes = _first_sizes(problem, slowest)
    return _Observing.of(problem, point, directions).with_sizes(sizes).cost


def predicting(
    problem: SegmentedMotion,
    point: Point,
    directions: FloatArray,  # (n_samples, n_rows)
    sizes: Sizes,
    corrected: NDArray[np.int64],  # (n_segments,)
) -> SegmentedMotion:
    """The motion that an observer follows for some samples of each segment, and then predicts."""
    observed = _Observing.of(problem, point, directions).with_sizes(sizes).motion
    if observed is None or observed.observer is None:
        raise ConvergenceError("prediction error", "the disturbed motion diverges")
    return replace(observed, observer=replace(observed.observer, corrected=corrected))


def _first_sizes(problem: SegmentedMotion, slowest: float) -> Sizes:
    """Noise as the signals' short differences have it, and disturbances of part of the motion."""
    segments = problem.segments
    squares = np.zeros(segments.outputs.shape[1])
    for part, sample_time in segments.by_recording():
        rates = np.gradient(segments.outputs[part], sample_time, axis=0)
        smooth = _smoothed(rates, max(1, round(0.01 / sample_time)))
        squares += np.sum(np.gradient(smooth, sample_time, axis=0) ** 2, axis=0)
    accelerations = np.sqrt(squares / len(segments.outputs))
    return Sizes(
        1.0 / problem.weights,
        _FIRST_SHARE * np.maximum(accelerations, np.finfo(float).tiny),
        np.full(len(accelerations), slowest),
    )


def _smoothed(values: FloatArray, half: int) -> FloatArray:
    """Moving mean over 2 half + 1 samples."""
    width = min(2 * half + 1, len(values))
    kernel = np.full(width, 1.0 / width)
    return np.column_stack([np.convolve(column, kernel, "same") for column in values.T])


def _bounds(first: Sizes, sample_time: float, slowest: float) -> tuple[FloatArray, FloatArray]:
    """Least and largest logarithm of each size."""
    motion = first.disturbances / _FIRST_SHARE
    rates = slowest, max(slowest, 1.0 / sample_time)
    least, largest = (
        Sizes(first.sensors * noise, motion * share, np.full(len(motion), rate)).logarithms
        for noise, share, rate in zip(_RANGES, _SHARES, rates, strict=True)
    )
    return least, largest


class _Observed(NamedTuple):
    """A motion with the observer for some sizes."""

    cost: float  # twice the negative logarithm of the likelihood, but for a constant
    motion: SegmentedMotion | None  # None where it diverges
    residuals: FloatArray  # (n_samples, n_outputs)
    entropy: float  # the part of the cost that no residual changes


@dataclass(frozen=True, eq=False)
class _Observing:
    """A motion at a point, to be observed with any sizes."""

    problem: SegmentedMotion
    point: Point
    directions: FloatArray  # (n_samples, n_rows)
    transitions: list[FloatArray]  # of each recording
    counts: list[FloatArray]  # the same: how many residuals of each output tell anything

    @classmethod
    def of(cls, problem: SegmentedMotion, point: Point, directions: FloatArray) -> "_Observing":
        """With the transitions at the point."""
        segments = problem.segments
        transitions = [
            transition_of(problem.linearised(point, recording), step)
            for recording, (_, step) in zip(
                segments.recordings[segments.firsts].tolist(), segments.by_recording(), strict=True
            )
        ]
        # A row without friction moves freely, however slowly.
        freely = (directions == RESTING) & ~problem.dry_rows(point)
        directions = np.where(freely, 0.0, directions)
        moves = directions != RESTING
        counts = [
            count * moves[part].mean(axis=0) if len(moves) else np.full(moves.shape[1], count)
            for count, (part, _) in zip(
                np.bincount(segments.places, segments.lengths),
                segments.by_recording(),
                strict=True,
            )
        ]
        return cls(problem, point, directions, transitions, counts)

    def with_sizes(self, sizes: Sizes) -> _Observed:
        """The motion with the observer for some sizes."""
        segments = self.problem.segments
        steps = segments.sample_times[segments.firsts]
        try:
            made = [
                steady_gains(self.problem, transition, step, sizes)
                for transition, step in zip(self.transitions, steps.tolist(), strict=True)
            ]
        except (LinAlgError, ValueError):
            return _Observed(WORST, None, segments.outputs, 0.0)
        entropy = sum(float(count @ own[4]) for count, own in zip(self.counts, made, strict=True))
        gain, disturbed, decay, whitening = (
            np.array([own[i] for own in made])[segments.places] for i in range(4)
        )
        observer = Observer(gain, disturbed, decay, self.directions, whitening, segments.lengths)
        motion = replace(self.problem, observer=observer)
        equations = motion.equations(self.point, "nothing")
        if not np.isfinite(equations.cost):
            return _Observed(WORST, None, equations.residuals, entropy)
        return _Observed(equations.cost + entropy, motion, equations.residuals, entropy)

    def likeliest(self, sizes: Sizes, bounds: tuple[FloatArray, FloatArray]) -> Sizes:
        """Sizes of the greatest likelihood, near some others, with few runs of the motion."""
        from scipy.optimize import minimize  # late: it takes a third of a second to import

        n = len(sizes.sensors)
        best = self.with_sizes(sizes)
        for _ in range(_SEARCHES):
            if best.motion is None:
                break
            cost = cost_by_spectra(best.motion, sizes, best.residuals, self.transitions)
            found = minimize(
                lambda x, cost=cost: cost(Sizes.of_logarithms(x, n)),
                np.clip(sizes.logarithms, *bounds),
                method="L-BFGS-B",
                bounds=np.column_stack(bounds),
                options={"maxiter": _ITERATIONS, "ftol": _NO_FALL / max(abs(best.cost), 1.0)},
            )
            other = Sizes.of_logarithms(found.x, n)
            seen = self.with_sizes(other)
            gain = best.cost - seen.cost
            if gain > 0.0:
                sizes, best = other, seen
            if gain < _SEARCHED:
                break
        return sizes
