"""Fit of innovations: the motion of a disturbed model, predicted sample by sample."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.prediction_error import Minimum, Steps, minimise
from flexid.estimators.segmented_motion import RESTING, Observer, Point, SegmentedMotion
from flexid.estimators.steady_gains import (
    Sizes,
    cost_by_spectra,
    steady_gains,
    transition_of,
)

_ROUNDS = (4, 2)  # alternations of sizes and coefficients: from first guesses, from given sizes
STEPS = (8, 30)  # largest number of slow Gauss-Newton steps: in each round, in the last round
_SEARCHES = 3  # largest number of searches for sizes, by spectra, in each round
_ITERATIONS = 30  # largest number of iterations of each search
_STEP = 1e-8  # of a size's number, for differences of the cost
_WORST = 1e15  # cost where the computation fails: finite, because costs are subtracted
_LEAST_FALL = 1.0  # of the cost: a smaller fall in an iteration ends a search
_LEAST_GAIN = 10.0  # of the cost: after a search with a smaller gain, no other follows
_FINE = 0.03  # length of a step, in standard deviations, that ends a fit
_FIRST_SHARE = 0.05  # first guess of a disturbance, over its row's acceleration
_RANGES = (1e-2, 1e2)  # bounds of a sensor's noise, over its first guess
_SHARES = (1e-4, 2.0)  # bounds of a disturbance, over its row's acceleration
# Bounds of a correlation: errors of a spring's torque have opposite signs on its two sides.
_CORRELATIONS = (-0.999, 0.0)
_FIRST_CORRELATION = -0.5  # first guess
# Least fall of the cost by all correlations. It was 5 or less for a bending arm, and 100 to 1700
# for drives whose gears have errors of angle.
_CORRELATED = 30.0


@dataclass(frozen=True, eq=False)
class Innovations:
    """Disturbed model fitted to a log."""

    problem: SegmentedMotion  # with its observer
    minimum: Minimum  # result of the last fit of coefficients
    sizes: Sizes  # of noise and disturbances
    cost: float  # -2 log likelihood, up to a constant


# Errors of the model act like a disturbance e of each row, e' = -κ e + white noise, of mean square
# σ²; sensors have white noise. The innovations of a Kalman filter are white if sizes and rates are
# right. Maximum likelihood estimates them (Ljung, System Identification, ch. 4).
def fit_innovations(
    problem: SegmentedMotion,
    point: Point,
    directions: FloatArray,  # (n_samples, n_rows)
    slowest: float,  # in 1/s
    sizes: Sizes | None = None,
    steps: tuple[int, int] = STEPS,
) -> Innovations:
    """Fit coefficients at fixed gains, and sizes of noise and disturbances, alternately."""
    first = _first_sizes(problem, slowest)
    bounds = _bounds(first, float(problem.segments.sample_times.max()), slowest)
    near = sizes is not None
    sizes = first if sizes is None else sizes
    found: Innovations | None = None
    rounds = _ROUNDS[near]
    for turn in range(rounds):
        likelihood = _Likelihood.of(problem, point, directions)
        # Fit initial states and coefficients first: sizes would take their errors for noise.
        if turn:
            sizes = likelihood.maximise(sizes, bounds)
        seen = likelihood.with_sizes(sizes)
        if seen.motion is None:
            raise ConvergenceError(
                "prediction error", "the disturbed motion diverges from the starting values"
            )
        most = Steps(_FINE, insist=False, iterations=steps[turn == rounds - 1])
        minimum = minimise(seen.motion, point, most)
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
    """Return -2 log likelihood of a point, up to a constant, for the first guess of the sizes."""
    sizes = _first_sizes(problem, slowest)
    return _Likelihood.of(problem, point, directions).with_sizes(sizes).cost


def predicting(
    problem: SegmentedMotion,
    point: Point,
    directions: FloatArray,  # (n_samples, n_rows)
    sizes: Sizes,
    corrected: NDArray[np.int64],  # (n_segments,)
) -> SegmentedMotion:
    """Return the motion that an observer corrects in the first samples of each segment only."""
    observed = _Likelihood.of(problem, point, directions).with_sizes(sizes).motion
    if observed is None or observed.observer is None:
        raise ConvergenceError("prediction error", "the disturbed motion diverges")
    return replace(observed, observer=replace(observed.observer, corrected=corrected))


def _first_sizes(problem: SegmentedMotion, slowest: float) -> Sizes:
    """First guess: noise from the weights, disturbances as a fraction of the accelerations."""
    from scipy.ndimage import uniform_filter1d  # late: it takes a third of a second to import

    segments = problem.segments
    squares = np.zeros(segments.outputs.shape[1])
    for part, sample_time in segments.by_recording():
        rates = np.gradient(segments.outputs[part], sample_time, axis=0)
        width = min(2 * max(1, round(0.01 / sample_time)) + 1, len(rates))
        smooth = uniform_filter1d(rates, width, axis=0, mode="constant")
        squares += np.sum(np.gradient(smooth, sample_time, axis=0) ** 2, axis=0)
    accelerations = np.sqrt(squares / len(segments.outputs))
    rows = len(accelerations)
    return Sizes(
        1.0 / problem.weights,
        _FIRST_SHARE * np.maximum(accelerations, np.finfo(float).tiny),
        np.full(rows, slowest),
        np.zeros(rows // 2),
    )


def _bounds(first: Sizes, sample_time: float, slowest: float) -> tuple[FloatArray, FloatArray]:
    """Smallest and largest number of each size."""
    motion = first.disturbances / _FIRST_SHARE
    rates = slowest, max(slowest, 1.0 / sample_time)
    least, largest = (
        Sizes(
            first.sensors * noise,
            motion * share,
            np.full(len(motion), rate),
            np.full(len(first.correlations), correlation),
        ).numbers
        for noise, share, rate, correlation in zip(
            _RANGES, _SHARES, rates, _CORRELATIONS, strict=True
        )
    )
    return least, largest


class _Observed(NamedTuple):
    """Motion with the observer for some sizes."""

    cost: float  # -2 log likelihood, up to a constant
    motion: SegmentedMotion | None  # None if it diverges
    residuals: FloatArray  # (n_samples, n_outputs)
    entropy: float  # part of the cost that is independent of the residuals


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Likelihood of sizes for the motion at a point."""

    problem: SegmentedMotion
    point: Point
    directions: FloatArray  # (n_samples, n_rows)
    transitions: list[FloatArray]  # transition matrix of each recording
    counts: list[FloatArray]  # of each recording: residuals of each output where its row moves

    @classmethod
    def of(cls, problem: SegmentedMotion, point: Point, directions: FloatArray) -> "_Likelihood":
        """Compute the transition matrices and counts at a point."""
        segments = problem.segments
        transitions = [
            transition_of(problem.linearised(point, recording), step)
            for recording, (_, step) in zip(
                segments.recordings[segments.firsts].tolist(), segments.by_recording(), strict=True
            )
        ]
        # A row without dry friction never rests.
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
        """Run the motion with the observer for some sizes."""
        segments = self.problem.segments
        steps = segments.sample_times[segments.firsts]
        try:
            made = [
                steady_gains(self.problem, transition, step, sizes)
                for transition, step in zip(self.transitions, steps.tolist(), strict=True)
            ]
        except (LinAlgError, ValueError):
            return _Observed(_WORST, None, segments.outputs, 0.0)
        entropy = sum(float(count @ own[4]) for count, own in zip(self.counts, made, strict=True))
        gain, disturbed, decay, whitening = (
            np.array([own[i] for own in made])[segments.places] for i in range(4)
        )
        observer = Observer(gain, disturbed, decay, self.directions, whitening, segments.lengths)
        motion = replace(self.problem, observer=observer)
        equations = motion.equations(self.point, "nothing")
        if not np.isfinite(equations.cost):
            return _Observed(_WORST, None, equations.residuals, entropy)
        return _Observed(equations.cost + entropy, motion, equations.residuals, entropy)

    def maximise(self, sizes: Sizes, bounds: tuple[FloatArray, FloatArray]) -> Sizes:
        """Maximise the likelihood over sizes, from given ones, with few runs of the motion.

        Disturbances without correlation stay so unless a correlation is clearly likelier. With one,
        they keep it.
        """
        if sizes.correlations.any():
            return self._search(sizes, bounds)[0]
        pairs, least = len(sizes.correlations), bounds[0].copy()
        least[len(least) - pairs :] = 0.0
        apart, cost = self._search(sizes, (least, bounds[1]))
        if not pairs:
            return apart
        begun = replace(sizes, correlations=np.full(pairs, _FIRST_CORRELATION))
        correlated, cost_correlated = self._search(begun, bounds)
        return correlated if cost_correlated < cost - _CORRELATED else apart

    def _search(self, sizes: Sizes, bounds: tuple[FloatArray, FloatArray]) -> tuple[Sizes, float]:
        """Return the likeliest sizes and their cost, from given ones."""
        n = len(sizes.sensors)
        best = self.with_sizes(sizes)
        for _ in range(_SEARCHES):
            if best.motion is None:
                break
            cost = cost_by_spectra(best.motion, sizes, best.residuals, self.transitions)
            fall = _LEAST_FALL / max(abs(best.cost), 1.0)
            other = Sizes.of(_cheapest(cost, n, sizes.numbers, bounds, fall), n)
            seen = self.with_sizes(other)
            gain = best.cost - seen.cost
            if gain > 0.0:
                sizes, best = other, seen
            if gain < _LEAST_GAIN:
                break
        return sizes, best.cost


def _cheapest(
    cost: Callable[[Sizes], FloatArray],
    rows: int,
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    fall: float,  # relative fall of the cost that ends the search
) -> FloatArray:
    """Return the numbers of the sizes of least cost, from a start."""
    from scipy.optimize import minimize  # imported here: it takes a third of a second

    numbers = np.clip(start, *bounds)
    free = np.flatnonzero(bounds[0] != bounds[1])

    def with_gradient(x: FloatArray) -> tuple[float, FloatArray]:
        """Cost and its forward differences; the points are computed together, which is faster."""
        numbers[free] = x
        points = np.tile(numbers, (1 + len(free), 1))
        moved = np.arange(len(free)) + 1, free
        points[moved] += np.where(x + _STEP > bounds[1][free], -_STEP, _STEP)
        costs = _costs(cost, rows, points)
        return float(costs[0]), (costs[1:] - costs[0]) / (points[moved] - x)

    numbers[free] = minimize(
        with_gradient,
        numbers[free],
        method="L-BFGS-B",
        jac=True,
        bounds=np.column_stack(bounds)[free],
        options={"maxiter": _ITERATIONS, "ftol": fall},
    ).x
    return numbers


def _costs(cost: Callable[[Sizes], FloatArray], rows: int, points: FloatArray) -> FloatArray:
    """Return the cost at each point, (n_points,), and `_WORST` where the computation fails."""
    try:
        return cost(Sizes.of(points, rows))
    except (LinAlgError, ValueError):
        if len(points) == 1:
            return np.array([_WORST])
        return np.concatenate([_costs(cost, rows, point[None]) for point in points])
