"""Segmented prediction error: the model's free run, fitted to the measured motion."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError
from flexid.estimators.channel_timing import Timing
from flexid.estimators.cluster_covariance import cluster_influences, covariance_of
from flexid.estimators.normal_equations import Reduced
from flexid.estimators.samples import Samples, divide
from flexid.estimators.segmented_motion import Equations, Point, SegmentedMotion, segmented_motion
from flexid.estimators.state_variable_filter import LeastSquaresFit
from flexid.estimators.unknowns import Unknowns, unknowns_of
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold
from flexid.recording.velocities import position_noise

FLAT = 2e-3  # predicted relative fall of the sum of squares below which a step may fail

ROUGH, FINE = 1.0, 1e-2
"""Length of the last step, in standard deviations, of an intermediate and of a final fit."""

ITERATIONS = 20  # largest number of slow steps; a good start needs about five steps in all

NEARLY_NOISE = 1.5
"""Variance of the weighted residuals up to which a rough minimum is accepted."""

_DAMPINGS = 8  # attempts at a step that does not raise the sum of squares
_FIRST_DAMPING = 1e-3
_LEAST_DAMPING = 1e-6  # smaller values become zero
_FAST = 0.5  # relative fall of the sum of squares above which a step is not slow
_POOR_GAIN = 0.25  # actual over predicted fall of the sum of squares below which a step is poor
_POOR_STEPS = 2  # poor steps in a row after which the minimum counts as rough
_NO_GAIN = 0.01  # actual over predicted fall below which a step is stuck
_STUCK_STEPS = 4  # stuck steps in a row after which the iteration ends
_IDLE_STEPS = 2  # steps in a row with too small a gain after which the iteration ends
_ROUNDING = 1e-11  # relative length of a step that is lost in rounding
_FINEST = 1e-9  # smallest noise, over the largest output: the noise of a 30-bit encoder


@dataclass(frozen=True)
class Steps:
    """Options of the Gauss-Newton steps and of the integration."""

    tolerance: float = ROUGH  # largest length of the last step in standard deviations
    insist: bool = True  # whether to raise without convergence
    iterations: int = ITERATIONS  # largest number of slow steps
    enough: float = 0.0  # variance of the residuals up to which convergence is not required
    promised: float = np.inf  # largest variance predicted by the first step, to go on
    least_gain: float = 0.0  # relative fall of the sum of squares below which steps end
    coarser: float = 1.0  # number of integration steps over the usual number
    most_substeps: float = np.inf  # largest number of integration steps per sample

    def taken_by(self, problem: SegmentedMotion) -> SegmentedMotion:
        """Return the motion with these integration steps."""
        substeps = min(np.ceil(self.coarser * problem.substeps), self.most_substeps)
        return replace(problem, substeps=int(substeps))


USUAL = Steps()
"""Steps that require convergence, with the usual integration."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """Point at which the iteration ended."""

    point: Point  # unknowns and initial states
    equations: Equations  # normal equations at the point
    reduced: Reduced  # normal equations after elimination of the initial states
    iterations: int  # number of steps taken
    # length in standard deviations of the step that would come next; if the iteration ran out of
    # steps, length of the last step taken
    last_step: float

    def variance(self, problem: SegmentedMotion) -> float:
        """Variance of the weighted residuals: 1 if the weights are right."""
        return self.equations.cost / problem.degrees_of_freedom

    def noise(self, problem: SegmentedMotion) -> FloatArray:
        """Standard deviation of each output's noise, shape (n_outputs,)."""
        squares = np.sum(self.equations.residuals**2, axis=0)
        return np.sqrt(squares * self.equations.residuals.shape[1] / problem.degrees_of_freedom)


def minimise(problem: SegmentedMotion, point: Point, steps: Steps) -> Minimum:
    """Minimise the sum of squares by damped Gauss-Newton steps that start at a point."""
    equations = problem.equations(point)
    if not np.isfinite(equations.cost):
        raise ConvergenceError(
            "prediction error",
            "the model's motion diverges from the starting values: start from a least-squares fit, "
            "or shorten the segments",
        )
    damping, last_step, taken, slow, poor, stuck, idle = 0.0, np.inf, 0, 0, 0, 0, 0
    while slow < steps.iterations and idle < _IDLE_STEPS:
        reduced = problem.solve(equations)
        variance = equations.cost / problem.degrees_of_freedom
        if (
            taken == 0
            and variance - reduced.decrement / problem.degrees_of_freedom > steps.promised
        ):
            raise ConvergenceError(
                "prediction error",
                "the first step leaves the model far from the log: shorten the segments",
            )
        last_step = np.sqrt(max(reduced.decrement, 0.0) / variance) if variance > 0.0 else 0.0
        if last_step <= steps.tolerance or _is_rounding(reduced, point):
            return Minimum(point, equations, reduced, taken, float(last_step))
        flat = reduced.decrement <= FLAT * equations.cost
        if poor >= _POOR_STEPS and flat and last_step <= max(1.0, 10.0 * steps.tolerance):
            return Minimum(point, equations, reduced, taken, float(last_step))
        if stuck >= _STUCK_STEPS:
            if not steps.insist or variance <= steps.enough or (flat and variance <= NEARLY_NOISE):
                return Minimum(point, equations, reduced, taken, float(last_step))
            raise ConvergenceError(
                "prediction error",
                f"{stuck} steps in a row gained almost nothing: start from a least-squares fit, "
                f"shorten the segments, or drop terms that the log does not determine",
            )
        before = equations.cost
        try:
            point, equations, damping = _descend(problem, point, equations, reduced, damping)
        except ConvergenceError:
            # Dry friction makes the sum of squares rough: near its minimum every step may fail.
            if steps.insist and not flat and variance > steps.enough:
                raise
            return Minimum(point, equations, reduced, taken, float(last_step))
        gain = before - equations.cost
        taken += 1
        slow += gain < _FAST * before
        poor = poor + 1 if gain < _POOR_GAIN * reduced.decrement else 0
        stuck = stuck + 1 if gain < _NO_GAIN * reduced.decrement else 0
        idle = idle + 1 if gain < steps.least_gain * before else 0
    reduced = problem.solve(equations)
    found = Minimum(point, equations, reduced, taken, float(last_step))
    rough = reduced.decrement <= FLAT * equations.cost  # steps back and forth across a minimum
    if not steps.insist or rough or found.variance(problem) <= steps.enough:
        return found
    raise ConvergenceError(
        "prediction error",
        f"no convergence within {steps.iterations} steps: start from a least-squares fit, shorten "
        f"the segments, or drop terms that the log does not determine",
    )


def _descend(
    problem: SegmentedMotion,
    point: Point,
    equations: Equations,
    undamped: Reduced,
    damping: float,
) -> tuple[Point, Equations, float]:
    """Take a step, damped until the sum of squares does not rise; return the next damping too."""
    for _ in range(_DAMPINGS):
        step = problem.solve(equations, damping) if damping > 0.0 else undamped
        trial = Point(point.values + step.values_step, point.initial_states + step.states_step)
        more, enough = max(10.0 * damping, _FIRST_DAMPING), equations.cost * (1.0 + 1e-12)
        # After a failed step the next may fail too: without derivatives, the test is cheap.
        if damping > 0.0 and not problem.equations(trial, "nothing").cost <= enough:
            damping = more
            continue
        tried = problem.equations(trial)
        if tried.cost <= enough:
            # A gain far below the predicted one is a jump across the minimum: damp more.
            overshot = equations.cost - tried.cost < _POOR_GAIN * step.decrement
            less = 0.1 * damping if damping > _LEAST_DAMPING else 0.0
            return trial, tried, more if overshot else less
        damping = more
    raise ConvergenceError(
        "prediction error",
        "no step brings the model closer to the log: start from a least-squares fit, or shorten "
        "the segments",
    )


def _is_rounding(step: Reduced, point: Point) -> bool:
    values = np.abs(step.values_step) <= _ROUNDING * np.abs(point.values)
    largest = np.abs(point.initial_states).max(axis=0)
    states = np.abs(step.states_step) <= _ROUNDING * largest
    return bool(values.all() and states.all())


def output_weights(
    noise: FloatArray,  # (n_outputs,)
    outputs: FloatArray,  # (n, n_outputs)
) -> FloatArray:
    """Return one over the noise of each output, or over `_FINEST` of the largest output."""
    floor = _FINEST * float(np.max(np.abs(outputs)))
    return 1.0 / np.maximum(noise, floor if floor > 0.0 else 1.0)


NEGLIGIBLE = 0.1
"""Largest integration error in standard deviations: a 95 % interval then covers 94.9 %."""

MOST = 4  # largest factor on the integration steps: 1/256 of the error, four times the duration

_ORDER = 4  # of the Runge-Kutta method


def integration_error(problem: SegmentedMotion, found: Minimum) -> float:
    """Estimate, by halved steps, the largest integration error in standard deviations."""
    halved = replace(problem, substeps=2 * problem.substeps)
    equations = halved.equations(found.point)
    variance = found.variance(problem)
    if not np.isfinite(equations.cost) or variance <= 0.0:
        return 0.0
    moved = halved.solve(equations).values_step - found.reduced.values_step
    square = float(moved @ found.reduced.information @ moved) / variance
    if not np.isfinite(square):
        return 0.0
    return float(np.sqrt(max(square, 0.0))) / (1.0 - 0.5**_ORDER)


def refinement(problem: SegmentedMotion, found: Minimum) -> int:
    """Return the factor on the steps, up to `MOST`, that makes the integration error negligible."""
    wanted = (integration_error(problem, found) / NEGLIGIBLE) ** (1.0 / _ORDER)
    return min(max(1, ceil(wanted)), MOST)


_AGREEMENT = 10.0  # allowed distance from least squares, in its standard deviations,
_SLACK = 1.0  # plus this fraction of the value, for errors of the model,
_EFFECT = 0.05  # plus this fraction of the row's acceleration, for coefficients near zero


@dataclass(frozen=True, eq=False)
class PredictionErrorFit:
    """Coefficients fitted by segmented prediction error. Only converged fits are returned."""

    names: tuple[str, ...]  # unknowns, row by row
    values: FloatArray  # (k,): in the system's units
    # (k, k): from the spread of the scores of blocks of at most 1 s, so valid for correlated
    # residuals. Infinite variance: undetermined, or determined by a single block
    covariance: FloatArray
    degrees_of_freedom: tuple[float, ...]  # of each variance, for Student's t; 0 if infinite
    # (k, k): Fisher information for residuals of size `noise`, with unknown initial states
    information: FloatArray
    noise: FloatArray  # (n_outputs,): standard deviation of the residuals
    residuals: FloatArray  # (n_samples, n_outputs): measured minus fitted, segment by segment

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation of each value, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))


# Each segment runs freely from an unknown initial state under the recorded input; with white noise
# the best fit is maximum likelihood. Integration steps are chosen from the poles and checked at the
# minimum, because residuals do not show errors of integration.
def prediction_error(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    start: LeastSquaresFit,
    segment_duration: float = 1.0,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
) -> PredictionErrorFit:
    """Fit the model's free run over segments to positions, or raise `ConvergenceError`."""
    unknowns = unknowns_of(system, len(recordings), unknowns)
    if start.names != unknowns.names:
        raise SettingError(
            "start", "it has another model or other unknowns: run least squares on these first"
        )
    segments = divide(recordings, segment_duration)
    problem = segmented_motion(system, segments, Timing(hold), unknowns)
    problem, found = _best_fit(problem, start.values)
    _compare(unknowns, found.point.values, start)
    return described(problem, found)


def described(problem: SegmentedMotion, found: Minimum) -> PredictionErrorFit:
    """Return the fit at a minimum, with covariance and residuals."""
    reduced = found.reduced
    blocks = np.diff(problem.first_blocks)
    segments = np.repeat(np.arange(len(blocks)), blocks)
    equations = found.equations.normal, found.equations.gradient
    influences, freedom = cluster_influences(*equations, segments, reduced.inverse)
    unknown = reduced.free | (freedom == 0.0)
    return PredictionErrorFit(
        problem.names,
        found.point.values,
        covariance_of(influences, unknown),
        tuple(np.where(unknown, 0.0, freedom).tolist()),
        reduced.information,
        found.noise(problem),
        found.equations.residuals[problem.segments.within],
    )


def _best_fit(problem: SegmentedMotion, values: FloatArray) -> tuple[SegmentedMotion, Minimum]:
    """Fit twice: with noise estimated from the signals, then with noise from the residuals."""
    outputs = problem.segments.outputs
    guess = np.array([position_noise(column) for column in outputs.T])
    point = Point(values, problem.start_states)
    problem = problem.at(point, output_weights(guess, outputs))
    coarse = minimise(problem, point, USUAL)
    problem = problem.at(coarse.point, output_weights(coarse.noise(problem), outputs))
    found = minimise(problem, coarse.point, Steps(FINE))
    finer = refinement(problem, found)
    if finer > 1:
        problem = problem.at(found.point, problem.weights, finer)
        found = minimise(problem, found.point, Steps(FINE))
    return problem, found


def _compare(unknowns: Unknowns, values: FloatArray, check: LeastSquaresFit) -> None:
    """Raise if an estimate is far from the least-squares fit of the same log."""
    deviations = check.standard_deviations
    effects = [
        np.sqrt(row.total_sum / gram) if gram > 0.0 else np.inf
        for row in check.rows
        for gram in np.diag(row.gram)
    ]
    for place, (name, value) in enumerate(zip(unknowns.names, values.tolist(), strict=True)):
        reference = float(check.values[place])
        allowed = _AGREEMENT * deviations[place] + _SLACK * abs(reference)
        allowed += _EFFECT * effects[place]
        if abs(value - reference) > allowed:
            raise ConvergenceError(
                "prediction error",
                f"{name!r} ended at {value:.4g} where least squares finds {reference:.4g}, so one "
                f"of them is wrong: start from a least-squares fit, or shorten the segments",
            )
