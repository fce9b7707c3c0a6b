"""Free run of a model over segments, and the normal equations of its fit to measured motion."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from types import ModuleType
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexid.arrays import FloatArray
from flexid.estimators.budget import spend
from flexid.estimators.channel_timing import INPUT, ChannelTiming, Timing
from flexid.estimators.cluster_covariance import block_duration
from flexid.estimators.normal_equations import Reduced, solve_arrow
from flexid.estimators.samples import Segments, first_states, in_threads
from flexid.estimators.unknowns import Unknowns
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem

if TYPE_CHECKING:
    from flexid.models.torque_balance import TorqueBalance

_SUBSTEPS_PER_RADIAN = 10.0  # the phase error of Runge-Kutta 4 is then below 1e-6 of the phase
_MOST_SUBSTEPS = 30.0  # per sample; motion above three radians per sample decays at once
_LARGEST = 1e100  # largest squared sensitivity; products of larger ones overflow
# information of an initial velocity's prior, in units of one sample's; 20 samples have 2500 units
_VELOCITY_PRIOR = 3.0
_WEAK = 100.0  # information over the prior's, below which an initial velocity gets the prior
_WEAK_OBSERVED = 1e-6  # the same ratio if an observer corrects the velocity from the start
_LINEARISED = 40  # number of states over which a linearisation is averaged
_NOT_ESTIMATED = -1
_WITHOUT_DERIVATIVES = 0.3  # duration of a run without derivatives over that of one with them
RESTING = 2.0  # marks a resting row in place of a direction of motion

By = Literal["everything", "states", "nothing"]
"""Variables of differentiation: unknowns and initial states, initial states alone, or none."""


@dataclass(frozen=True, eq=False)
class Observer:
    """Correction of a predicted motion, and of each row's disturbance, by measured outputs."""

    gain: FloatArray  # (n_segments, 2 n_rows, n_outputs): of positions and velocities
    # (n_segments, n_rows, n_outputs): of the disturbances, which are accelerations of the rows
    disturbance_gain: FloatArray
    # (n_segments, n_rows): factor on a disturbance per sampling interval
    decay: FloatArray
    # (n_samples, n_rows): mean direction, from -1 to 1, of each row's motion, thus of its friction,
    # over the interval after each sample. `RESTING` marks an unknown direction: the row then
    # follows its sensor. With no samples, friction is set-valued
    directions: FloatArray
    # (n_segments, n_outputs, n_outputs): lower triangle that makes the innovations white and of
    # unit size
    whitening: FloatArray
    # (n_segments,): number of samples that correct the motion; then the model runs freely
    corrected: NDArray[np.int64]

    @property
    def resting(self) -> NDArray[np.bool_]:
        """Mask of the intervals after each sample in which a row rests, (n_samples, n_rows)."""
        return self.directions == RESTING


@dataclass(frozen=True, eq=False)
class Point:
    """Values of the unknowns, shape (k,), and initial states, (n_segments, n_states)."""

    values: FloatArray
    initial_states: FloatArray


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations at a point, divided into blocks."""

    cost: float  # weighted sum of squares; infinite if the motion diverged
    # (n_blocks, n, n): normal matrix of each block: first its segment's initial state, then the
    # unknowns, if the motion is differentiated by them
    normal: FloatArray
    gradient: FloatArray  # (n_blocks, n): right-hand sides
    residuals: FloatArray  # (n_samples, n_outputs): measured minus computed outputs
    costs: FloatArray  # (n_segments,): cost of each segment; infinite if its motion diverged

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Mask of the segments whose motion diverged, shape (n_segments,)."""
        return ~np.isfinite(self.costs)


@dataclass(frozen=True, eq=False)
class SegmentedMotion:
    """Problem of fitting a model's motion to segments; made by `segmented_motion`."""

    segments: Segments  # measured samples
    unknowns: Unknowns  # unknown coefficients
    timing: Timing  # hold and delays
    constants: FloatArray  # values of the model's constants
    substeps: int  # steps of Runge-Kutta 4 per sampling interval
    weights: FloatArray  # (n_outputs,): one over the standard deviation of each output's noise
    _kernel: ModuleType
    # corrects the motion at each sample, so that the residuals are innovations. Friction then has
    # the direction given by the observer, and no row sticks
    observer: Observer | None = field(default=None, kw_only=True)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns: coefficients, then delays."""
        order = (INPUT, *self._channels.output_delays)
        return (*self.unknowns.names, *(name for name in order if name in self.timing.sought))

    @cached_property
    def references(self) -> tuple[int | None, ...]:
        """Index of the output that each output was measured relative to; None without one."""
        places = self._channels.reference.tolist()
        return tuple(place // 2 if place >= 0 else None for place in places)

    @cached_property
    def _channels(self) -> ChannelTiming:
        return ChannelTiming(self.segments, self.unknowns.system, self.timing)

    @cached_property
    def first_blocks(self) -> NDArray[np.int64]:
        """Index of every segment's first block for the covariance, then the number of blocks."""
        segments = self.segments
        total = float(np.sum(segments.lengths * segments.sample_times))
        return segments.first_blocks(block_duration(total))

    @property
    def degrees_of_freedom(self) -> int:
        """Number of measured values minus number of unknowns and initial states, at least 1."""
        sought = len(self.segments) * self._kernel.N_STATES + len(self.names)
        measured = int(self.segments.lengths.sum()) * self.segments.outputs.shape[1]
        if self.observer is not None:
            measured -= int(self.observer.resting.sum())
        return max(1, measured - sought)

    def at(self, point: Point, weights: FloatArray, refinement: int = 1) -> "SegmentedMotion":
        """Return the problem with new weights, and with steps that suit the poles at a point."""
        resting = point.initial_states.copy()
        resting[:, 1::2] = 0.0  # smoothed friction is steepest at rest
        coefficients = self._coefficients(point.values)
        jacobians = np.concatenate(
            [self._jacobians(states, coefficients) for states in (point.initial_states, resting)]
        )
        # Only states with a finite linearisation have poles.
        usable = jacobians[np.isfinite(jacobians).all(axis=(1, 2))]
        # The decay of a hysteresis memory is computed in closed form and needs no short steps.
        memories = np.arange(2 * self._kernel.N_ROWS, self._kernel.N_STATES)
        usable[:, memories, memories] = 0.0
        fastest = float(np.abs(np.linalg.eigvals(usable)).max(initial=0.0))
        phase = fastest * float(self.segments.sample_times.max())
        substeps = max(1, int(np.ceil(min(_SUBSTEPS_PER_RADIAN * phase, _MOST_SUBSTEPS))))
        return replace(self, substeps=refinement * substeps, weights=weights)

    @property
    def start_states(self) -> FloatArray:
        """Starting values of the initial states from measured positions, (n_segments, n_states)."""
        return self.with_memories(first_states(self.segments))

    def with_memories(self, states: FloatArray) -> FloatArray:
        """Return initial states with this model's hysteresis memories; new memories are 0."""
        rows = 2 * self._kernel.N_ROWS
        if states.shape[1] == self._kernel.N_STATES:
            return states
        return np.pad(states[:, :rows], ((0, 0), (0, self._kernel.N_STATES - rows)))

    def driven_by(self, signal: FloatArray) -> "SegmentedMotion":
        """Return the problem with another first input, shape (n_samples,)."""
        inputs = self.segments.inputs.copy()
        inputs[:, 0] = signal
        return replace(self, segments=replace(self.segments, inputs=inputs))

    def delays(self, values: FloatArray) -> dict[str, float]:
        """Return every delay in s at some values of the unknowns."""
        k = len(self.unknowns.names)
        found = zip(self.names[k:], np.asarray(values)[k:].tolist(), strict=True)
        none = dict.fromkeys((INPUT, *self._channels.output_delays), 0.0)
        return {**none, **self.timing.delays, **dict(found)}

    @cached_property
    def _observer(self) -> Observer:
        """Given observer; by default one without gains, which only weights the residuals."""
        if self.observer is not None:
            return self.observer
        n, rows = len(self.segments), self._kernel.N_ROWS
        return Observer(
            np.zeros((n, 2 * rows, 0)),
            np.zeros((n, rows, 0)),
            np.zeros((n, rows)),
            np.zeros((0, rows)),
            np.tile(np.diag(self.weights), (n, 1, 1)),
            np.zeros(n, dtype=np.int64),
        )

    @property
    def whitening(self) -> FloatArray:
        """Factor of each segment's residuals, (n_segments, n_outputs, n_outputs)."""
        return self._observer.whitening

    def linearised(self, point: Point, recording: int) -> FloatArray:
        """Return the rates' mean derivatives by the states of a recording, (2 n_rows, 2 n_rows)."""
        segments = self.segments
        own = np.flatnonzero(segments.recordings == recording)
        first, last = segments.starts[own[0]], segments.starts[own[-1]] + segments.lengths[own[-1]]
        places = np.linspace(first, last - 1, _LINEARISED).astype(np.int64)
        step = float(segments.sample_times[own[0]])
        states = np.zeros((_LINEARISED, self._kernel.N_STATES))
        rates = np.gradient(segments.outputs[first:last], step, axis=0)
        rows = 2 * self._kernel.N_ROWS
        states[:, :rows:2] = segments.outputs[places]
        states[:, 1:rows:2] = rates[places - first]
        coefficients = self.unknowns.coefficients(
            point.values[: len(self.unknowns.names)], recording
        )
        about = replace(self, segments=replace(segments, starts=places))
        found = about._jacobians(states, np.tile(coefficients, (_LINEARISED, 1)))
        return found.mean(axis=0)[:rows, :rows]

    def _coefficients(self, values: FloatArray) -> FloatArray:
        """Coefficients of every segment, shape (n_segments, n_coefficients)."""
        sought = values[: len(self.unknowns.names)]
        recordings = self.segments.recordings[self.segments.firsts].tolist()
        found = [self.unknowns.coefficients(sought, recording) for recording in recordings]
        return np.array(found)[self.segments.places]

    def _jacobians(self, states: FloatArray, coefficients: FloatArray) -> FloatArray:
        """Derivatives of the rates by the states, at one state per segment's start."""
        kernel = self._kernel
        n, rows = kernel.N_STATES, 2 * kernel.N_ROWS
        inputs = self.segments.inputs[self.segments.starts]
        jacobians = np.zeros((len(states), n, n))
        velocities = np.arange(1, rows, 2)
        jacobians[:, velocities - 1, velocities] = 1.0
        found = np.zeros((len(states), kernel.N_EQUATIONS * n))
        linearise = segments_kernel().linearise
        states = np.ascontiguousarray(states)
        linearise(states, inputs, coefficients, self.constants, kernel.MODEL, found)
        places = [*velocities.tolist(), *range(rows, n)]
        jacobians[:, places] = found.reshape(len(states), -1, n)
        return jacobians

    @cached_property
    def _wanted(self) -> NDArray[np.int64]:
        """Indices of the coefficients by which some segment's motion is differentiated."""
        recordings = self.segments.recordings[self.segments.firsts].tolist()
        # This includes tied coefficients, which are no unknowns themselves.
        nonzero = np.ones(len(self.unknowns.names))
        slopes = [self.unknowns.derivatives(nonzero, recording) for recording in recordings]
        return np.flatnonzero(np.any(slopes, axis=(0, 2)))

    def dry_rows(self, point: Point) -> NDArray[np.bool_]:
        """Return a mask of the rows with known or unknown dry friction, shape (n_rows,)."""
        used = np.any(self._coefficients(point.values) != 0.0, axis=0)
        used[self._wanted] = True
        # The last index means a known part, which has no coefficient.
        used = np.append(used, True)
        return np.array([used[list(places)].any() for places in self._kernel.DRY], dtype=np.bool_)

    def on_time(self, values: FloatArray) -> FloatArray:
        """Return the outputs without their delays, shape (n_samples, n_outputs)."""
        return self._channels.on_time(self.delays(values))

    def equations(self, point: Point, by: By = "everything") -> Equations:
        """Run the model from a point and assemble the normal equations.

        Raises `BudgetError` if a search has taken too many integration steps.
        """
        effort = _WITHOUT_DERIVATIVES if by == "nothing" else 1.0
        spend(effort * self.substeps * float(self.segments.lengths.sum()))
        wanted = self._wanted if by == "everything" else self._wanted[:0]
        columns, late_columns, size = self._columns(wanted, by)
        normal, gradient, residuals, costs = self._run(point, columns, late_columns, size)
        normal += np.tril(normal, -1).transpose(0, 2, 1)
        # Added in the segments' order, so that rounding does not depend on the threads.
        cost = float(np.sum(costs))
        overflowed = ~np.all(np.abs(normal) < _LARGEST, axis=(1, 2))
        if overflowed.any():
            cost = np.inf
            normal[overflowed], gradient[overflowed] = 0.0, 0.0  # their values are invalid
        if by == "everything":
            normal, gradient = self._by_unknowns(normal, gradient, point.values, wanted)
        # A memory lies between -1 and 1, so its prior has a standard deviation of 1.
        firsts = self.first_blocks[:-1]
        for place in range(2 * self._kernel.N_ROWS, self._kernel.N_STATES):
            memory = point.initial_states[:, place]
            cost += float(memory @ memory)
            costs += memory**2
            if by != "nothing":
                normal[firsts, place, place] += 1.0
                gradient[firsts, place] -= memory
        return Equations(cost, normal, gradient, residuals, costs)

    def _run(
        self,
        point: Point,
        columns: NDArray[np.int64],
        late_columns: NDArray[np.int64],  # (n_outputs,)
        size: int,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Run the kernel: lower triangles of normal matrices, gradients, residuals, costs."""
        segments, kernel, channels = self.segments, self._kernel, self._channels
        delays = self.delays(point.values)
        outputs = channels.on_time(delays)
        speeds = np.zeros((0, outputs.shape[1]))  # empty: velocities of the model
        if self.observer is not None and np.any(late_columns != _NOT_ESTIMATED):
            speeds = channels.rates_on_time(delays)  # an observer follows the measured motion
        observer = self._observer
        whitening = np.ascontiguousarray(observer.whitening)
        divided = (
            segments.starts,
            segments.lengths,
            self.first_blocks,
            segments.sample_times,
            np.ascontiguousarray(point.initial_states),
        )
        sensors = outputs, channels.reference, late_columns, whitening, speeds
        gains = (
            observer.gain,
            observer.disturbance_gain,
            observer.decay,
            observer.directions,
            observer.corrected,
        )
        gains = tuple(map(np.ascontiguousarray, gains))  # other layouts would be compiled again
        coefficients, dry = self._coefficients(point.values), self.dry_rows(point)
        motion = channels.drives(delays[INPUT]), coefficients, self.constants, dry, gains
        trace = 1.0 / np.diag(whitening[0])  # standard deviation of each position's noise
        count = int(self.first_blocks[-1])
        normal, gradient = np.zeros((count, size, size)), np.zeros((count, size))
        results = normal, gradient, np.zeros_like(segments.outputs), np.zeros(len(segments))
        segment_equations = segments_kernel().segment_equations

        def run(*part: int) -> None:
            settings = self.substeps, trace, columns.copy()  # each thread marks sticking rows here
            segment_equations(part, divided, sensors, motion, *settings, results, kernel.MODEL)

        in_threads(run, segments.lengths)
        return results

    def _columns(
        self, wanted: NDArray[np.int64], by: By
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
        """Columns of the kernel, column of each output's delay, and number of equations."""
        places, states = segments_kernel(), self._kernel.N_STATES
        sought = self.timing.sought if by == "everything" else ()
        carried = 0 if by == "nothing" else states + len(wanted) + (INPUT in sought)
        columns = np.zeros(places.AT + self._kernel.N_COEFFICIENTS, dtype=np.int64)
        columns[places.DELAY] = carried if INPUT in sought else 0
        late_columns = np.full(self.segments.outputs.shape[1], _NOT_ESTIMATED, dtype=np.int64)
        late = [a for a, name in enumerate(self._channels.output_delays) if name in sought]
        size = carried + len(late)
        late_columns[late] = np.arange(carried, size)
        if self.observer is not None:  # corrections of the state depend on the outputs' delays
            carried = size
        columns[places.IN_USE] = 1 + carried
        columns[places.AT + wanted] = 1 + states + np.arange(len(wanted))
        return columns, late_columns, size

    def _by_unknowns(
        self,
        normal: FloatArray,
        gradient: FloatArray,
        values: FloatArray,
        wanted: NDArray[np.int64],
    ) -> tuple[FloatArray, FloatArray]:
        """Convert normal equations of each recording's coefficients to those of the unknowns."""
        n_states, k = self._kernel.N_STATES, len(self.unknowns.names)
        n_delays = len(self.names) - k
        firsts = self.first_blocks
        chained, pulled = [], []
        recordings = self.segments.recordings
        edges = [*self.segments.firsts.tolist(), len(recordings)]
        for a, b in pairwise(edges):
            blocks = slice(firsts[a], firsts[b])
            slopes = self.unknowns.derivatives(values[:k], int(recordings[a]))[wanted]
            chain = np.asarray(block_diag(np.eye(n_states), slopes, np.eye(n_delays)))
            chained.append(chain.T @ normal[blocks] @ chain)
            pulled.append(gradient[blocks] @ chain)
        return np.concatenate(chained), np.concatenate(pulled)

    def solve(self, equations: Equations, damping: float = 0.0) -> Reduced:
        """Solve the normal equations for a step, with the damping of Levenberg and Marquardt."""
        firsts = self.first_blocks[:-1]
        normal = np.add.reduceat(equations.normal, firsts, axis=0)
        gradient = np.add.reduceat(equations.gradient, firsts, axis=0)
        # If a row sticks at once, its initial velocity is undetermined: it gets a weak prior.
        # An observer makes any initial velocity decay, so that little information remains.
        weak = _WEAK if self.observer is None else _WEAK_OBSERVED
        for a in range(self.segments.outputs.shape[1]):
            velocity = 2 * a + 1
            prior = _VELOCITY_PRIOR * (self.weights[a] * self.segments.sample_times) ** 2
            own = normal[:, velocity, velocity]
            normal[:, velocity, velocity] = np.where(own < weak * prior, own + prior, own)
        return solve_arrow(normal, gradient, self._kernel.N_STATES, damping)


def segmented_motion(
    system: ParametricSystem,
    segments: Segments,
    timing: Timing,
    unknowns: Unknowns | None = None,
) -> SegmentedMotion:
    """Return the problem of fitting a model to segments, with equal weights of all outputs."""
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    weights = np.ones(segments.outputs.shape[1])
    unknowns = unknowns or Unknowns(system)
    kernel = motion_kernel(system)
    return SegmentedMotion(segments, unknowns, timing, constants, 1, weights, kernel)


MOTION = ("sin_cos", "model")  # templates of a model's motion for the kernel of the segments


def motion_kernel(system: "ParametricSystem | TorqueBalance") -> ModuleType:
    """Load the compiled motion of a model, which the kernel of the segments calls."""

    def build() -> str:
        if isinstance(system, ParametricSystem):
            from flexid.derivation.sensitivities import sensitivity_functions

            return sensitivity_functions(system, "Motion and its derivatives")
        from flexid.derivation.torque_balance import balance_functions

        return balance_functions(system)

    task = "motion" if isinstance(system, ParametricSystem) else "torque_balance"
    return load_kernel(task, [system.digest], build, MOTION)


def balance_columns(
    balance: "TorqueBalance",
    signals: FloatArray,  # (n_samples, n_rows, 3)
    inputs: FloatArray,  # (n_samples, n_joints)
    modes: FloatArray | None = None,  # (n_samples, n_rows): of friction; by default sign(velocity)
) -> FloatArray:
    """Return the regressors of all parameters, shape (n_samples, n_rows, n_parameters)."""
    kernel = motion_kernel(balance)
    constants = np.array(list(balance.constants.values()), dtype=np.float64)
    found = np.zeros((len(signals), len(balance.rows), len(balance.coefficients)))
    states = np.ascontiguousarray(signals[:, :, :2].reshape(len(signals), -1))
    modes = np.ascontiguousarray(np.sign(signals[:, :, 1]) if modes is None else modes)
    accelerations = np.ascontiguousarray(signals[:, :, 2])
    kernel.columns(states, np.ascontiguousarray(inputs), modes, constants, accelerations, found)
    return found


def segments_kernel() -> ModuleType:
    """Load the compiled equations of segments, which are the same for all models."""
    return load_kernel("segments", (), None, ["prediction_error"])
