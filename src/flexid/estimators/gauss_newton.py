"""Gauss-Newton over segments, damped after Levenberg and Marquardt where a full step fails."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexid.errors import ConvergenceError
from flexid.estimators.arrow import Reduced, solve_arrow
from flexid.estimators.block_sandwich import block_duration
from flexid.estimators.cluster_covariance import Clusters
from flexid.estimators.samples import FloatArray
from flexid.estimators.segments import FEWEST_SAMPLES, Segments, first_states
from flexid.estimators.threads import in_threads
from flexid.estimators.unknowns import FIXED, Unknowns
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_ITERATIONS = 30  # far beyond the five or so that a good start takes
_HALVINGS = 4  # of segments too long to be fitted from the start at once
_DAMPINGS = 8  # attempts at a step that makes nothing worse
_FIRST_DAMPING = 1e-3
_LEAST_DAMPING = 1e-6  # less than this is none
_POOR_GAIN = 0.25  # of the fall of the sum of squares that a step promised
_ROUNDING = 1e-11  # relative length of a step that is lost in rounding
_SUBSTEPS_PER_RADIAN = 10.0  # the phase error of Runge-Kutta 4 is then below 1e-6 of the phase
_MOST_SUBSTEPS = 100.0  # per sample; a model still faster is fitted badly, and then refused
_LARGEST = 1e100  # sensitivities squared; beyond it their products overflow


@dataclass(frozen=True, eq=False)
class Point:
    """What is sought: coefficients, shape (k,), and initial states, (n_segments, n_states)."""

    values: FloatArray
    initial_states: FloatArray


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations at a point, block by block.

    Parameters
    ----------
    cost : float
        Weighted sum of squares; infinite if the motion diverged.
    normal : array, shape (n_blocks, n, n)
        Normal matrix of each block, its segment's initial state first, then what is sought.
    gradient : array, shape (n_blocks, n)
        Right-hand sides.
    residuals : array, shape (n_samples, n_outputs)
        Measured less computed outputs.
    """

    cost: float
    normal: FloatArray
    gradient: FloatArray
    residuals: FloatArray


@dataclass(frozen=True, eq=False)
class SegmentedMotion:
    """A model's motion over segments, beside the measured one; made by `segmented_motion`.

    Parameters
    ----------
    segments : Segments
        What was measured.
    unknowns : Unknowns
        What is sought.
    constants : array
        Values of the model's constants.
    held : bool
        Whether inputs are constant over each interval.
    substeps : int
        Steps of Runge-Kutta 4 per sampling interval.
    weights : array, shape (n_outputs,)
        One over the standard deviation of each output's noise.
    """

    segments: Segments
    unknowns: Unknowns
    constants: FloatArray
    held: bool
    substeps: int
    weights: FloatArray
    _kernel: ModuleType

    @cached_property
    def first_blocks(self) -> NDArray[np.int64]:
        """First block of every segment, and the number of blocks: what a covariance is from."""
        segments = self.segments
        total = float(np.sum(segments.lengths * segments.sample_times))
        return segments.first_blocks(block_duration(total))

    @property
    def degrees_of_freedom(self) -> int:
        """Measured numbers less unknowns, at least 1."""
        sought = len(self.segments) * self._kernel.N_STATES + len(self.unknowns.names)
        return max(1, self.segments.outputs.size - sought)

    def at(self, point: Point, weights: FloatArray) -> "SegmentedMotion":
        """The same with weights, and with steps short enough for the motion about a point."""
        resting = point.initial_states.copy()
        resting[:, 1::2] = 0.0  # smoothed friction is steepest at rest
        coefficients = self._coefficients(point.values)
        jacobians = np.array(
            [
                self._jacobian(state, self.segments.inputs[first], p)
                for states in (point.initial_states, resting)
                for first, state, p in zip(self.segments.starts, states, coefficients, strict=True)
            ]
        )
        # Where the model has no linearisation, nothing is said of its poles.
        usable = jacobians[np.isfinite(jacobians).all(axis=(1, 2))]
        fastest = float(np.abs(np.linalg.eigvals(usable)).max(initial=0.0))
        phase = fastest * float(self.segments.sample_times.max())
        substeps = max(1, int(np.ceil(min(_SUBSTEPS_PER_RADIAN * phase, _MOST_SUBSTEPS))))
        return replace(self, substeps=substeps, weights=weights)

    def _coefficients(self, values: FloatArray) -> FloatArray:
        """Coefficients of every segment, shape (n_segments, n_coefficients)."""
        return self._by_segment(lambda piece: self.unknowns.coefficients(values, piece))

    def _by_segment(self, of_piece: Callable[[int], NDArray[Any]]) -> NDArray[Any]:
        """What each segment takes from its piece, stacked."""
        pieces, place = np.unique(self.segments.pieces, return_inverse=True)
        return np.array([of_piece(piece) for piece in pieces.tolist()])[place]

    def _jacobian(self, state: FloatArray, inputs: FloatArray, p: FloatArray) -> FloatArray:
        """Derivatives of the rates by the states, about a state."""
        kernel = self._kernel
        states = slice(1, 1 + kernel.N_STATES)
        columns = np.zeros((kernel.N_STATES, 1 + kernel.N_STATES))
        columns[:, 0] = state
        columns[:, states] = np.eye(kernel.N_STATES)
        rates = np.empty_like(columns)
        none = np.zeros(kernel.N_COEFFICIENTS, dtype=np.int64)
        kernel.variation_rates(columns, inputs, p, self.constants, none, rates)
        return rates[:, states]

    def equations(self, point: Point) -> Equations:
        """Run the model from a point and put up the normal equations."""
        segments, kernel = self.segments, self._kernel
        columns = self._by_segment(self.unknowns.columns)
        wanted = np.flatnonzero(np.any(columns != FIXED, axis=0))
        size = kernel.N_STATES + len(wanted)
        count = int(self.first_blocks[-1])
        normal = np.zeros((count, size, size))
        gradient = np.zeros((count, size))
        residuals = np.zeros_like(segments.outputs)
        costs = np.zeros(len(segments))
        coefficients = self._coefficients(point.values)

        def run(first: int, stop: int) -> None:
            kernel.segment_equations(
                first,
                stop,
                segments.starts,
                segments.lengths,
                self.first_blocks,
                segments.sample_times,
                point.initial_states,
                segments.measured,
                segments.outputs,
                self.weights,
                segments.inputs,
                coefficients,
                self.constants,
                wanted,
                self.held,
                self.substeps,
                normal,
                gradient,
                residuals,
                costs,
            )

        in_threads(run, segments.lengths)
        # Segment by segment in their order, so that no digit depends on the threads.
        cost = float(np.sum(costs))
        if not np.all(np.abs(normal) < _LARGEST):
            cost = np.inf
        columns = np.repeat(columns[:, wanted], np.diff(self.first_blocks), axis=0)
        normal, gradient = _gathered(
            normal, gradient, columns, kernel.N_STATES, len(self.unknowns.names)
        )
        return Equations(cost, normal, gradient, residuals)

    def solve(self, equations: Equations, damping: float = 0.0) -> Reduced:
        """The step that the equations ask for."""
        firsts = self.first_blocks[:-1]
        normal = np.add.reduceat(equations.normal, firsts, axis=0)
        gradient = np.add.reduceat(equations.gradient, firsts, axis=0)
        return solve_arrow(normal, gradient, self._kernel.N_STATES, damping)

    def clusters(self, found: "Minimum") -> Clusters:
        """The problem at a minimum, block by block: what its covariance is computed from."""
        blocks = np.diff(self.first_blocks)
        return Clusters(
            found.equations.normal,
            found.equations.gradient,
            np.repeat(np.arange(len(blocks)), blocks),
            found.reduced.inverse,
        )


@dataclass(frozen=True, eq=False)
class Minimum:
    """Where the iteration ended: converged, or `minimise` raises.

    Parameters
    ----------
    point : Point
        The unknowns.
    equations : Equations
        Normal equations there.
    reduced : Reduced
        The same without the initial states.
    iterations : int
        Steps taken.
    last_step : float
        Length of the step that was not taken any more, in standard deviations.
    """

    point: Point
    equations: Equations
    reduced: Reduced
    iterations: int
    last_step: float

    def variance(self, problem: SegmentedMotion) -> float:
        """Variance of the weighted residuals: 1 if the weights are right."""
        return self.equations.cost / problem.degrees_of_freedom

    def noise(self, problem: SegmentedMotion) -> FloatArray:
        """Standard deviation of each output's noise, shape (n_outputs,)."""
        squares = np.sum(self.equations.residuals**2, axis=0)
        return np.sqrt(squares * self.equations.residuals.shape[1] / problem.degrees_of_freedom)


def _gathered(
    normal: FloatArray,
    gradient: FloatArray,
    columns: NDArray[np.int64],
    n_states: int,
    n_names: int,
) -> tuple[FloatArray, FloatArray]:
    """Normal equations of blocks for all that is sought, in its order.

    Parameters
    ----------
    normal : array, shape (n_blocks, n_states + n_wanted, n_states + n_wanted)
        For the initial state and the coefficients that some segment wants.
    gradient : array, shape (n_blocks, n_states + n_wanted)
        Right-hand sides.
    columns : array of int, shape (n_blocks, n_wanted)
        Place of these coefficients among what is sought, or `FIXED`.
    n_states, n_names : int
        Size of a state, and how many coefficients are sought.
    """
    count, n_wanted = columns.shape
    if n_wanted == n_names and (columns == np.arange(n_names)).all():
        return normal, gradient
    # What a block wants in vain goes to one place more, which is then cut off.
    places = np.empty((count, n_states + n_wanted), dtype=np.int64)
    places[:, :n_states] = np.arange(n_states)
    places[:, n_states:] = n_states + np.where(columns == FIXED, n_names, columns)
    size = n_states + n_names
    wide = np.zeros((count, size + 1, size + 1))
    tall = np.zeros((count, size + 1))
    block = np.arange(count)[:, None]
    wide[block[:, :, None], places[:, :, None], places[:, None, :]] = normal
    tall[block, places] = gradient
    return wide[:, :size, :size], tall[:, :size]


def segmented_motion(
    system: ParametricSystem, segments: Segments, hold: Hold, unknowns: Unknowns | None = None
) -> SegmentedMotion:
    """The motion of a model over segments, all outputs of the same weight."""

    def build() -> str:
        from flexid.derivation.sensitivities import sensitivity_functions

        return sensitivity_functions(system, "Segmented prediction error")

    kernel = load_kernel("prediction_error", [system.digest], build, ["prediction_error"])
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    weights = np.ones(len(segments.measured))
    unknowns = unknowns or Unknowns(system)
    return SegmentedMotion(segments, unknowns, constants, hold == "zero", 1, weights, kernel)


def approach(problem: SegmentedMotion, point: Point, tolerance: float) -> Minimum:
    """As `minimise`; where that fails, by way of segments of half the length.

    Over a long segment a wrong start leads far from the measured motion, and the sum of squares
    has other minima there. What a shorter segment tells starts a longer one well.
    """
    return _approach(problem, point, tolerance, _HALVINGS)


def _approach(problem: SegmentedMotion, point: Point, tolerance: float, halvings: int) -> Minimum:
    try:
        return minimise(problem, point, tolerance)
    except ConvergenceError:
        if halvings == 0 or problem.segments.lengths.min() < 2 * FEWEST_SAMPLES:
            raise
    halves = problem.segments.halved()
    start = Point(point.values, first_states(halves))
    found = _approach(replace(problem, segments=halves), start, tolerance, halvings - 1).point
    return minimise(problem, Point(found.values, found.initial_states[::2]), tolerance)


def minimise(problem: SegmentedMotion, point: Point, tolerance: float) -> Minimum:
    """Least sum of squares near a point.

    Parameters
    ----------
    problem : SegmentedMotion
        What to fit.
    point : Point
        Where to start.
    tolerance : float
        The iteration ends where the next step is shorter than this, in standard deviations.

    Raises
    ------
    ConvergenceError
        If the motion diverges at the start, no step helps, or the steps do not end.
    """
    equations = problem.equations(point)
    if not np.isfinite(equations.cost):
        raise ConvergenceError(
            "prediction error",
            "the model's motion diverges from the starting values: start from a least-squares fit, "
            "or shorten the segments",
        )
    damping = 0.0
    for iterations in range(_ITERATIONS):
        reduced = problem.solve(equations)
        variance = equations.cost / problem.degrees_of_freedom
        last_step = np.sqrt(max(reduced.decrement, 0.0) / variance) if variance > 0.0 else 0.0
        if last_step <= tolerance or _is_rounding(reduced, point):
            return Minimum(point, equations, reduced, iterations, float(last_step))
        point, equations, damping = _descend(problem, point, equations, reduced, damping)
    raise ConvergenceError(
        "prediction error",
        f"the steps do not end within {_ITERATIONS}: start from a least-squares fit, shorten the "
        f"segments, or drop terms that the record does not show",
    )


def _descend(
    problem: SegmentedMotion,
    point: Point,
    equations: Equations,
    undamped: Reduced,
    damping: float,
) -> tuple[Point, Equations, float]:
    """One step that makes nothing worse, damped as much as it takes; and the damping to go on."""
    for _ in range(_DAMPINGS):
        step = problem.solve(equations, damping) if damping > 0.0 else undamped
        trial = Point(point.values + step.values_step, point.initial_states + step.states_step)
        tried = problem.equations(trial)
        more = max(10.0 * damping, _FIRST_DAMPING)
        if tried.cost <= equations.cost * (1.0 + 1e-12):
            # Steps that gain far less than promised jump to and fro across the minimum.
            overshot = equations.cost - tried.cost < _POOR_GAIN * step.decrement
            less = 0.1 * damping if damping > _LEAST_DAMPING else 0.0
            return trial, tried, more if overshot else less
        damping = more
    raise ConvergenceError(
        "prediction error",
        "no step brings the model closer to the record: start from a least-squares fit, or shorten "
        "the segments",
    )


def _is_rounding(step: Reduced, point: Point) -> bool:
    values = np.abs(step.values_step) <= _ROUNDING * np.abs(point.values)
    largest = np.abs(point.initial_states).max(axis=0)
    states = np.abs(step.states_step) <= _ROUNDING * largest
    return bool(values.all() and states.all())
