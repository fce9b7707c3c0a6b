"""Innovations: the motion of a disturbed model, predicted sample by sample.

A model never describes a drive exactly. What it lacks acts like a torque that comes and goes, so
each row may have a disturbance e, an acceleration with a size σ and a rate κ of its own,

    e' = -κ e + white noise,    mean square σ²

and each sensor white noise. An observer with the gain of Kalman's filter follows both; what it
cannot foresee, the innovations, is white if sizes and rates are right. They are where the
likelihood of the innovations is greatest. With no disturbance this is the prediction error over
the whole log. The idea is that of the innovations form in Ljung, System Identification, ch. 4.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, expm

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError
from flexid.estimators.gauss_newton import Minimum, minimise
from flexid.estimators.segmented_motion import Observer, Point, SegmentedMotion

_ROUNDS = (4, 2)  # of sizes and coefficients in turn, from afar and from values nearly right
_STEPS = (8, 30)  # of Gauss and Newton in each, and in the last
_TRIALS = (80, 40)  # of sizes and rates in each, of one joint; of more in proportion
_OF_ONE_JOINT = 6  # sizes and rates: those of two sensors and two rows
_SPREAD = 0.7  # natural logarithm, by which the first trials differ; less in later rounds
_FINE = 0.03  # standard deviations, of a step that ends an iteration
_WORST = 1e15  # cost of what cannot be computed
_FIRST_SHARE = 0.05  # of its row's acceleration, that a disturbance has to begin with
_DOUBLINGS = 40  # of the time within which a filter has to settle
_STEADY = 1e-10  # of a covariance, by which the last doubling changes it
_RANGES = (1e-2, 1e2)  # of a sensor's noise, over that of its signal's short differences
_SHARES = (1e-4, 2.0)  # of a disturbance, over its row's acceleration


@dataclass(frozen=True, eq=False)
class Sizes:
    """What drives the innovations apart from the input."""

    sensors: FloatArray  # (n_outputs,): standard deviation of each output's noise, in rad
    disturbances: FloatArray  # (n_rows,): root mean square of each row's disturbance, in rad/s²
    rates: FloatArray  # (n_rows,): how fast each changes, in 1/s

    @classmethod
    def of_logarithms(cls, logarithms: FloatArray, n_outputs: int) -> "Sizes":
        """Those with some natural logarithms, shape (n_outputs + 2 n_rows,)."""
        sensors, rest = np.split(np.exp(logarithms), [n_outputs])
        return cls(sensors, *np.split(rest, 2))

    @property
    def logarithms(self) -> FloatArray:
        """Natural logarithms of all."""
        return np.log(np.concatenate((self.sensors, self.disturbances, self.rates)))


@dataclass(frozen=True, eq=False)
class Innovations:
    """A disturbed model fitted to a log."""

    problem: SegmentedMotion  # with its observer
    minimum: Minimum  # where the fit ended
    sizes: Sizes  # of noise and disturbances
    cost: float  # twice the negative logarithm of the likelihood, but for a constant


def fit_innovations(
    problem: SegmentedMotion,
    point: Point,
    directions: FloatArray,  # (n_samples, n_rows)
    slowest: float,  # in 1/s
    sizes: Sizes | None = None,
) -> Innovations:
    """Fit coefficients, and sizes of noise and disturbances, in turn.

    While the coefficients take their steps the gains are held; the sizes are sought with the
    coefficients held.
    """
    first = _first_sizes(problem, slowest)
    bounds = _bounds(first, float(problem.segments.sample_times.max()), slowest)
    near = sizes is not None
    sizes = first if sizes is None else sizes
    found: Innovations | None = None
    rounds = _ROUNDS[near]
    for turn in range(rounds):
        cost_of = _cost(problem, point, directions)
        # Initial states come first, with the coefficients: what they leave passes for noise.
        if turn:
            spread = _SPREAD / (2.0 if near else turn)
            sizes = _likeliest(cost_of, sizes, bounds, spread, _TRIALS[near])
        cost, observed = cost_of(sizes)
        if observed is None:
            raise ConvergenceError(
                "prediction error", "the disturbed motion diverges from the starting values"
            )
        minimum = minimise(
            observed, point, _FINE, insist=False, iterations=_STEPS[turn == rounds - 1]
        )
        point = minimum.point
        cost += minimum.equations.cost - observed.equations(point, "nothing").cost
        found = Innovations(observed, minimum, sizes, cost)
    assert found is not None
    return found


def predicting(
    problem: SegmentedMotion,
    point: Point,
    directions: FloatArray,  # (n_samples, n_rows)
    sizes: Sizes,
    corrected: NDArray[np.int64],  # (n_segments,)
) -> SegmentedMotion:
    """The motion that an observer follows for so many samples of each segment, and then predicts.

    Raises
    ------
    ConvergenceError
        If it diverges.
    """
    _, observed = _cost(problem, point, directions)(sizes)
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
    return tuple(
        Sizes(first.sensors * noise, motion * share, np.full(len(motion), rate)).logarithms
        for noise, share, rate in zip(_RANGES, _SHARES, rates, strict=True)
    )  # type: ignore[return-value]


def _likeliest(
    cost: Callable[[Sizes], tuple[float, SegmentedMotion | None]],
    sizes: Sizes,
    bounds: tuple[FloatArray, FloatArray],
    spread: float,
    trials: int,
) -> Sizes:
    """Sizes of the greatest likelihood, near some others."""
    from scipy.optimize import minimize  # late: it takes a third of a second to import

    start, n = np.clip(sizes.logarithms, *bounds), len(sizes.sensors)
    found = minimize(
        lambda x: cost(Sizes.of_logarithms(np.clip(x, *bounds), n))[0],
        start,
        method="Nelder-Mead",
        options={
            "maxfev": trials * max(1, len(start) // _OF_ONE_JOINT),
            "fatol": 1.0,
            "xatol": 0.05,
            "initial_simplex": np.vstack((start, start + spread * np.eye(len(start)))),
        },
    )
    return Sizes.of_logarithms(np.clip(found.x, *bounds), n)


def _cost(
    problem: SegmentedMotion, point: Point, directions: FloatArray
) -> Callable[[Sizes], tuple[float, SegmentedMotion | None]]:
    """What sizes cost at a point, and the motion with their observer; None where it diverges."""
    segments = problem.segments
    recordings = np.unique(segments.recordings).tolist()
    steps = [float(segments.sample_times[segments.recordings == r][0]) for r in recordings]
    transitions = [
        _transition(problem.linearised(point, recording), step)
        for recording, step in zip(recordings, steps, strict=True)
    ]

    def cost(sizes: Sizes) -> tuple[float, SegmentedMotion | None]:
        made, entropy = {}, 0.0
        try:
            for recording, step, transition in zip(recordings, steps, transitions, strict=True):
                made[recording] = _steady_gains(problem, transition, step, sizes)
                count = segments.lengths[segments.recordings == recording].sum()
                entropy += float(count) * made[recording][4]
        except (LinAlgError, ValueError):
            return _WORST, None
        gains = [
            np.array([made[recording][i] for recording in segments.recordings.tolist()])
            for i in range(4)
        ]
        observer = Observer(gains[0], gains[1], gains[2], directions, gains[3], segments.lengths)
        observed = replace(problem, observer=observer)
        squares = observed.equations(point, "nothing").cost
        if not np.isfinite(squares):
            return _WORST, None
        return squares + entropy, observed

    return cost


def _transition(jacobian: FloatArray, sample_time: float) -> FloatArray:
    """What one interval makes of states and of disturbances that are constant over it.

    Returns shape (n_states + n_rows, n_states + n_rows).
    """
    n, rows = len(jacobian), len(jacobian) // 2
    forced = np.zeros((n + rows, n + rows))
    forced[:n, :n] = jacobian
    forced[1:n:2, n:] = np.eye(rows)
    return np.asarray(expm(forced * sample_time), dtype=np.float64)


def _steady_gains(
    problem: SegmentedMotion, transition: FloatArray, sample_time: float, sizes: Sizes
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, float]:
    """Kalman's gains of states and disturbances, the decay, the whitening, and log det S.

    A disturbance is constant over an interval, which it enters with what the one before left of it
    and what the sample at its start has taught: d <- decay d + G e.
    """
    rows = len(sizes.rates)
    n = len(transition) - rows
    step, decay = transition.copy(), np.exp(-sizes.rates * sample_time)
    step[n:, n:] = np.diag(decay)
    noise = np.zeros_like(step)
    noise[n:, n:] = np.diag(sizes.disturbances**2 * (1.0 - decay**2))
    sees = np.zeros((len(problem.segments.measured), n + rows))
    sees[np.arange(len(sees)), problem.segments.measured] = 1.0
    sensors = _sensor_covariance(problem, sizes.sensors)
    predicted = _steady_covariance(step, noise, sees, sensors)
    covariance = sees @ predicted @ sees.T + sensors
    gain = np.asarray(np.linalg.solve(covariance, sees @ predicted).T, dtype=np.float64)
    triangle = np.linalg.cholesky(covariance)
    whitening = np.asarray(np.tril(np.linalg.inv(triangle)), dtype=np.float64)
    entropy = 2.0 * float(np.log(np.diag(triangle)).sum())
    return gain[:n], gain[n:], decay, whitening, entropy


def _steady_covariance(
    step: FloatArray, noise: FloatArray, sees: FloatArray, sensors: FloatArray
) -> FloatArray:
    """Covariance of a predicted state that a sample no longer changes, by doubling the time.

    Anderson and Moore, Optimal Filtering (1979), sec. 6.7.
    """
    forward = step.T
    information = sees.T @ np.linalg.solve(sensors, sees)
    covariance = noise
    unit = np.eye(len(step))
    for _ in range(_DOUBLINGS):
        inverse = np.linalg.inv(unit + information @ covariance)
        more = forward.T @ covariance @ inverse @ forward
        information = information + forward @ inverse @ information @ forward.T
        forward = forward @ inverse @ forward
        covariance = covariance + more
        if np.abs(more).max() <= _STEADY * np.abs(covariance).max():
            return 0.5 * (covariance + covariance.T)
    raise LinAlgError("the filter does not settle")


def _sensor_covariance(problem: SegmentedMotion, sensors: FloatArray) -> FloatArray:
    """Of the outputs' noise; one that was measured relative to another has the other's as well."""
    reference = problem.references
    mixing = np.eye(len(sensors))
    for a, other in enumerate(reference):
        if other is not None:
            mixing[a, other] = 1.0
    return mixing @ np.diag(sensors**2) @ mixing.T
