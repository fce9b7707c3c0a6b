"""A model's motion over segments beside the measured one, and the normal equations of their fit."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from types import ModuleType
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import INPUT, ChannelTiming, Timing
from flexid.estimators.cluster_covariance import Clusters, block_duration
from flexid.estimators.normal_equations import Reduced, solve_arrow
from flexid.estimators.samples import Segments, first_states, in_threads
from flexid.estimators.unknowns import Unknowns
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem

if TYPE_CHECKING:
    from flexid.models.torque_balance import TorqueBalance

_SUBSTEPS_PER_RADIAN = 10.0  # the phase error of Runge-Kutta 4 is then below 1e-6 of the phase
_MOST_SUBSTEPS = 30.0  # per sample; what is faster than three radians in one is over in no time
_LARGEST = 1e100  # sensitivities squared; beyond it their products overflow
# times the information of one sample on a velocity; twenty have 2500 times that
_SEEN_SAMPLES = 3.0
_HARDLY = 100.0  # times that, up to which a velocity is hardly seen
_FORGOTTEN = 1e-6  # the same where an observer corrects it from the first sample on
_LINEARISED = 40  # states over which a linearisation is the mean
_NOT_SOUGHT = -1
RESTING = 2.0  # in place of a direction

By = Literal["everything", "states", "nothing"]
"""What a motion is differentiated by: all that is sought, initial states alone, or nothing."""


@dataclass(frozen=True, eq=False)
class Observer:
    """Corrects a predicted motion, and disturbances of each row, by what was measured."""

    gain: FloatArray  # (n_segments, 2 n_rows, n_outputs): of positions and velocities
    # (n_segments, n_rows, n_outputs): of the disturbances, which are accelerations of the rows
    disturbance_gain: FloatArray
    # (n_segments, n_rows): share of a disturbance that one sampling interval leaves
    decay: FloatArray
    # (n_samples, n_rows): mean direction, from -1 to 1, of each row's motion over the interval from
    # each sample on: the direction of its friction; `RESTING` where that may be any, so that the
    # row follows its sensor. With no samples, friction is set-valued
    directions: FloatArray
    # (n_segments, n_outputs, n_outputs): lower triangle that makes the innovations white and of
    # unit size
    whitening: FloatArray
    # (n_segments,): how many samples of a segment correct the motion; then the model runs alone
    corrected: NDArray[np.int64]

    @property
    def resting(self) -> NDArray[np.bool_]:
        """Where each row rests over the interval from each sample on, shape (n_samples, n_rows)."""
        return self.directions == RESTING


@dataclass(frozen=True, eq=False)
class Point:
    """What is sought: coefficients, shape (k,), and initial states, (n_segments, n_states)."""

    values: FloatArray
    initial_states: FloatArray


@dataclass(frozen=True, eq=False)
class Equations:
    """Normal equations at a point, block by block."""

    cost: float  # weighted sum of squares; infinite if the motion diverged
    # (n_blocks, n, n): normal matrix of each block, its segment's initial state first, then what is
    # sought, as far as the motion is differentiated by it
    normal: FloatArray
    gradient: FloatArray  # (n_blocks, n): right-hand sides
    residuals: FloatArray  # (n_samples, n_outputs): measured less computed outputs
    costs: FloatArray  # (n_segments,): the part of each segment; infinite where its motion diverged

    @property
    def diverged(self) -> NDArray[np.bool_]:
        """Segments whose motion did, shape (n_segments,)."""
        return ~np.isfinite(self.costs)


@dataclass(frozen=True, eq=False)
class SegmentedMotion:
    """A model's motion over segments, beside the measured one; made by `segmented_motion`."""

    segments: Segments  # what was measured
    unknowns: Unknowns  # which coefficients are sought
    timing: Timing  # hold and delays
    constants: FloatArray  # values of the model's constants
    substeps: int  # steps of Runge-Kutta 4 per sampling interval
    weights: FloatArray  # (n_outputs,): one over the standard deviation of each output's noise
    _kernel: ModuleType
    # what corrects the motion on its way, so that the residuals are innovations. Friction then has
    # the direction that the observer knows, and no row sticks
    observer: Observer | None = field(default=None, kw_only=True)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What is sought: coefficients, then delays."""
        order = (INPUT, *self._channels.output_delays)
        return (*self.unknowns.names, *(name for name in order if name in self.timing.sought))

    @cached_property
    def references(self) -> tuple[int | None, ...]:
        """For each output the one that it was measured relative to, if there is one."""
        places = self._channels.reference.tolist()
        return tuple(place // 2 if place >= 0 else None for place in places)

    @cached_property
    def _channels(self) -> ChannelTiming:
        return ChannelTiming(self.segments, self.unknowns.system, self.timing)

    @cached_property
    def first_blocks(self) -> NDArray[np.int64]:
        """First block of every segment, and the number of blocks: what a covariance is from."""
        segments = self.segments
        total = float(np.sum(segments.lengths * segments.sample_times))
        return segments.first_blocks(block_duration(total))

    @property
    def degrees_of_freedom(self) -> int:
        """Measured numbers less unknowns, at least 1."""
        sought = len(self.segments) * self._kernel.N_STATES + len(self.names)
        measured = int(self.segments.lengths.sum()) * self.segments.outputs.shape[1]
        if self.observer is not None:
            measured -= int(self.observer.resting.sum())
        return max(1, measured - sought)

    def at(self, point: Point, weights: FloatArray, refinement: int = 1) -> "SegmentedMotion":
        """The same with weights, and with steps short enough for the motion about a point."""
        resting = point.initial_states.copy()
        resting[:, 1::2] = 0.0  # smoothed friction is steepest at rest
        coefficients = self._coefficients(point.values)
        jacobians = np.concatenate(
            [self._jacobians(states, coefficients) for states in (point.initial_states, resting)]
        )
        # Where the model has no linearisation, nothing is said of its poles.
        usable = jacobians[np.isfinite(jacobians).all(axis=(1, 2))]
        # What a memory forgets along its path is computed in closed form, however fast.
        memories = np.arange(2 * self._kernel.N_ROWS, self._kernel.N_STATES)
        usable[:, memories, memories] = 0.0
        fastest = float(np.abs(np.linalg.eigvals(usable)).max(initial=0.0))
        phase = fastest * float(self.segments.sample_times.max())
        substeps = max(1, int(np.ceil(min(_SUBSTEPS_PER_RADIAN * phase, _MOST_SUBSTEPS))))
        return replace(self, substeps=refinement * substeps, weights=weights)

    @property
    def start_states(self) -> FloatArray:
        """Where initial states may begin, shape (n_segments, n_states): near what was measured."""
        return self.with_memories(first_states(self.segments))

    def with_memories(self, states: FloatArray) -> FloatArray:
        """Initial states of the same rows, with this model's memories: of no direction, if new."""
        rows = 2 * self._kernel.N_ROWS
        if states.shape[1] == self._kernel.N_STATES:
            return states
        return np.pad(states[:, :rows], ((0, 0), (0, self._kernel.N_STATES - rows)))

    def delays(self, values: FloatArray) -> dict[str, float]:
        """Every delay in s at some values of what is sought."""
        k = len(self.unknowns.names)
        found = zip(self.names[k:], np.asarray(values)[k:].tolist(), strict=True)
        none = dict.fromkeys((INPUT, *self._channels.output_delays), 0.0)
        return {**none, **self.timing.delays, **dict(found)}

    @cached_property
    def _observer(self) -> Observer:
        """The observer; without one, gains of no columns, and the sensors' noise as it is."""
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

    def linearised(self, point: Point, recording: int) -> FloatArray:
        """Derivatives of the rates by positions and velocities, (2 n_rows, 2 n_rows)."""
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
        """Derivatives of the rates by the states, about a state at the start of each segment."""
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
        """Places of the coefficients that some segment's motion is differentiated by."""
        recordings = self.segments.recordings[self.segments.firsts].tolist()
        # A tie makes a coefficient matter that is not sought itself: the pattern of derivatives.
        slopes = [self.unknowns.depends(recording) for recording in recordings]
        return np.flatnonzero(np.any(slopes, axis=(0, 2)))

    def dry_rows(self, point: Point) -> NDArray[np.bool_]:
        """Rows with dry friction, or with one that is sought, shape (n_rows,)."""
        return self._dry(self._coefficients(point.values), self._wanted)

    def _dry(self, coefficients: FloatArray, wanted: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Rows with dry friction, or with one that is sought."""
        used = np.any(coefficients != 0.0, axis=0)
        used[wanted] = True
        # The last place stands for a known part, which has no coefficient.
        used = np.append(used, True)
        return np.array([used[list(places)].any() for places in self._kernel.DRY], dtype=np.bool_)

    def on_time(self, values: FloatArray) -> FloatArray:
        """Outputs, shape (n_samples, n_outputs), moved to when they were true."""
        return self._channels.on_time(self.delays(values))

    def equations(self, point: Point, by: By = "everything") -> Equations:
        """Run the model from a point and put up the normal equations."""
        wanted = self._wanted if by == "everything" else self._wanted[:0]
        columns, late_columns, size = self._columns(wanted, by)
        normal, gradient, residuals, costs = self._run(point, columns, late_columns, size)
        normal += np.tril(normal, -1).transpose(0, 2, 1)
        # Segment by segment in their order, so that no digit depends on the threads.
        cost = float(np.sum(costs))
        overflowed = ~np.all(np.abs(normal) < _LARGEST, axis=(1, 2))
        if overflowed.any():
            cost = np.inf
            normal[overflowed], gradient[overflowed] = 0.0, 0.0  # these say nothing
        if by == "everything":
            normal, gradient = self._gathered(normal, gradient, point.values, wanted)
        # A memory is between -1 and 1 wherever a segment starts, so that it is known by about 1.
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
        """Lower halves of the blocks' normal equations, gradients, residuals; segments' costs."""
        segments, kernel, channels = self.segments, self._kernel, self._channels
        delays = self.delays(point.values)
        outputs = channels.on_time(delays)
        speeds = np.zeros((0, outputs.shape[1]))  # by the model
        if self.observer is not None and np.any(late_columns != _NOT_SOUGHT):
            speeds = channels.rates_on_time(delays)  # an observer follows what was measured
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
        gains = tuple(map(np.ascontiguousarray, gains))  # of one layout, or it compiles again
        coefficients = self._coefficients(point.values)
        dry = self._dry(coefficients, self._wanted)
        motion = channels.drives(delays[INPUT]), coefficients, self.constants, dry, gains
        trace = 1.0 / np.diag(whitening[0])  # standard deviation of each position's noise
        count = int(self.first_blocks[-1])
        normal, gradient = np.zeros((count, size, size)), np.zeros((count, size))
        results = normal, gradient, np.zeros_like(segments.outputs), np.zeros(len(segments))
        segment_equations = segments_kernel().segment_equations

        def run(*part: int) -> None:
            settings = self.substeps, trace, columns.copy()  # a thread notes there what may stick
            segment_equations(part, divided, sensors, motion, *settings, results, kernel.MODEL)

        in_threads(run, segments.lengths)
        return results

    def _columns(
        self, wanted: NDArray[np.int64], by: By
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
        """The kernel's columns, that of each output's delay, and the equations' size."""
        places, states = segments_kernel(), self._kernel.N_STATES
        sought = self.timing.sought if by == "everything" else ()
        carried = 0 if by == "nothing" else states + len(wanted) + (INPUT in sought)
        columns = np.zeros(places.AT + self._kernel.N_COEFFICIENTS, dtype=np.int64)
        columns[places.DELAY] = carried if INPUT in sought else 0
        late_columns = np.full(self.segments.outputs.shape[1], _NOT_SOUGHT, dtype=np.int64)
        size = carried
        for a, name in enumerate(self._channels.output_delays):
            if name in sought:
                late_columns[a] = size
                size += 1
        if self.observer is not None:  # what corrects the state depends on how late outputs are
            carried = size
        columns[places.IN_USE] = 1 + carried
        columns[places.AT + wanted] = 1 + states + np.arange(len(wanted))
        return columns, late_columns, size

    def _gathered(
        self,
        normal: FloatArray,
        gradient: FloatArray,
        values: FloatArray,
        wanted: NDArray[np.int64],
    ) -> tuple[FloatArray, FloatArray]:
        """Normal equations for what is sought from those for the coefficients of each recording."""
        n_states, k = self._kernel.N_STATES, len(self.unknowns.names)
        n_delays = len(self.names) - k
        firsts = self.first_blocks
        chained, pulled = [], []
        recordings = self.segments.recordings
        edges = [*self.segments.firsts.tolist(), len(recordings)]
        for a, b in pairwise(edges):
            blocks = slice(firsts[a], firsts[b])
            slopes = self.unknowns.derivatives(values[:k], int(recordings[a]))[wanted]
            chain = np.zeros((n_states + len(wanted) + n_delays, n_states + k + n_delays))
            chain[:n_states, :n_states] = np.eye(n_states)
            chain[n_states : n_states + len(wanted), n_states : n_states + k] = slopes
            chain[n_states + len(wanted) :, n_states + k :] = np.eye(n_delays)
            chained.append(chain.T @ normal[blocks] @ chain)
            pulled.append(gradient[blocks] @ chain)
        return np.concatenate(chained), np.concatenate(pulled)

    def solve(self, equations: Equations, damping: float = 0.0) -> Reduced:
        """The step that the equations ask for."""
        firsts = self.first_blocks[:-1]
        normal = np.add.reduceat(equations.normal, firsts, axis=0)
        gradient = np.add.reduceat(equations.gradient, firsts, axis=0)
        # The first velocity of a row that sticks at once leaves no trace and would wander off.
        # An observer forgets any, but not at once.
        hardly = _HARDLY if self.observer is None else _FORGOTTEN
        for a in range(self.segments.outputs.shape[1]):
            velocity = 2 * a + 1
            least = _SEEN_SAMPLES * (self.weights[a] * self.segments.sample_times) ** 2
            own = normal[:, velocity, velocity]
            normal[:, velocity, velocity] = np.where(own < hardly * least, own + least, own)
        return solve_arrow(normal, gradient, self._kernel.N_STATES, damping)

    def clusters(self, equations: Equations, reduced: Reduced) -> Clusters:
        """The problem at a minimum, block by block: what its covariance is computed from."""
        blocks = np.diff(self.first_blocks)
        return Clusters(
            equations.normal,
            equations.gradient,
            np.repeat(np.arange(len(blocks)), blocks),
            reduced.inverse,
        )


def segmented_motion(
    system: ParametricSystem,
    segments: Segments,
    timing: Timing,
    unknowns: Unknowns | None = None,
) -> SegmentedMotion:
    """The motion of a model over segments, all outputs of the same weight."""
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    weights = np.ones(segments.outputs.shape[1])
    unknowns = unknowns or Unknowns(system)
    kernel = motion_kernel(system)
    return SegmentedMotion(segments, unknowns, timing, constants, 1, weights, kernel)


MOTION = ("sin_cos", "model")  # templates by which the kernel of the segments moves a model


def motion_kernel(system: "ParametricSystem | TorqueBalance") -> ModuleType:
    """The compiled motion of a model, for the kernel of the segments to call."""

    def build() -> str:
        if isinstance(system, ParametricSystem):
            from flexid.derivation.sensitivities import sensitivity_functions

            return sensitivity_functions(system, "Motion and its derivatives")
        from flexid.derivation.torque_balance import balance_functions

        return balance_functions(system)

    task = "motion" if isinstance(system, ParametricSystem) else "torque_balance"
    return load_kernel(task, [system.digest], build, MOTION)


def segments_kernel() -> ModuleType:
    """The compiled equations of segments, which are the same for all models."""
    return load_kernel("segments", (), None, ["prediction_error"])
