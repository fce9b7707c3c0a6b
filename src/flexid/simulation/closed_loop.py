"""Closed loops, their runs, and their simulation in continuous time."""

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import asdict, dataclass, field
from functools import cached_property
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

import flexid
from flexid.arrays import FloatArray
from flexid.errors import SettingError, SimulationError, check_names
from flexid.kernels.store import load_kernel
from flexid.kernels.templates.run_status import BOUND
from flexid.models.parametric_system import ParametricSystem
from flexid.paper.laws import Controller
from flexid.paper.loop import LoopDeclaration, Multisine


@dataclass(frozen=True)
class ClosedLoop:
    """System, controller, reference and parameter observer, with their values."""

    # model of plant and observer, with the values of its constants
    system: ParametricSystem
    coefficients: Mapping[str, float]  # the true coefficients
    controller: Controller
    reference: Multisine
    observer_gains: Mapping[str, float]  # observer gain c by the name of the row
    # p̂ at the start, by coefficient; 0 for those left out
    initial_estimates: Mapping[str, float] = field(default_factory=dict)
    # x at the start, in the order of system.states; all 0 if left out
    initial_state: Sequence[float] = ()

    def __post_init__(self) -> None:
        rows = tuple(row.name for row in self.system.rows)
        check_values("coefficients", self.coefficients, self.system.coefficients)
        check_values("observer_gains", self.observer_gains, rows)
        check_values("initial_estimates", self.initial_estimates, self.system.coefficients, False)
        state = tuple(map(float, self.initial_state)) or (0.0,) * len(self.system.states)
        if len(state) != len(self.system.states):
            raise SettingError(
                "initial_state", f"has {len(state)} values for {len(self.system.states)} states"
            )
        object.__setattr__(self, "initial_state", state)
        self.declaration  # noqa: B018 - checks that the parts fit together

    @cached_property
    def declaration(self) -> LoopDeclaration:
        """Loop without its values."""
        return LoopDeclaration(self.system, self.controller, self.reference)

    def with_values(self, **values: Any) -> "ClosedLoop":
        """Return a copy of the loop with other values of the same names, without new checks."""
        changed = copy(self)  # shares the cached declaration
        for name, value in values.items():
            object.__setattr__(changed, name, value)
        return changed

    @property
    def true_coefficients(self) -> NDArray[np.float64]:
        """True coefficients p in the system's order."""
        return np.array([self.coefficients[name] for name in self.system.coefficients])

    @property
    def start_estimates(self) -> NDArray[np.float64]:
        """Initial estimates p̂ in the system's order."""
        return np.array([self.initial_estimates.get(p, 0.0) for p in self.system.coefficients])

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Run-time parameters of the compiled loop, in the declaration's order."""
        gains = [self.observer_gains[row.name] for row in self.system.rows]
        values = (
            *self.true_coefficients,
            *self.system.constants.values(),
            *self.controller.values.values(),
            *self.reference.parameters.values(),
            *gains,
        )
        return np.array(values, dtype=float)


def check_values(
    setting: str, values: Mapping[str, float], names: tuple[str, ...], complete: bool = True
) -> None:
    """Raise `SettingError` for a value of an unknown name, or if one is missing."""
    check_names(setting, values, names)
    missing = [name for name in names if name not in values]
    if complete and missing:
        raise SettingError(setting, f"{', '.join(missing)} missing: give a value for each")


@dataclass(frozen=True)
class Integration:
    """Duration, sample time and tolerances of a simulation in continuous time."""

    duration: float  # in s; the run ends at the last sample within it
    sample_time: float = 1e-3  # in s, of the result; the integrator chooses its own steps
    relative_tolerance: float = 1e-6  # per step, of each coordinate and each parameter error
    absolute_tolerance: float | None = None  # in SI units; default: relative one / 1000
    maximum_steps: int = 1_000_000  # accepted and rejected, until the run is aborted

    def __post_init__(self) -> None:
        if self.absolute_tolerance is None:
            object.__setattr__(self, "absolute_tolerance", 1e-3 * self.relative_tolerance)
        for name, value in asdict(self).items():
            if not 0.0 < value < np.inf:
                raise SettingError(name, f"{value!r} must be a positive number")

    @property
    def count(self) -> int:
        """Number of samples."""
        return int(np.floor(self.duration / self.sample_time * (1.0 + 1e-12))) + 1

    @property
    def end(self) -> float:
        """Time of the last sample in s."""
        return (self.count - 1) * self.sample_time

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of all samples in s."""
        return self.sample_time * np.arange(self.count, dtype=np.float64)


@dataclass(frozen=True)
class Run:
    """Simulated motion of a closed loop with n samples, in SI units."""

    # simulated loop: model, true coefficients, controller, reference and observer
    loop: ClosedLoop
    time: FloatArray  # (n,), in s
    states: FloatArray  # (n, n_states), x, in plain coordinates, in the order of loop.system.states
    inputs: FloatArray  # (n, n_inputs), u, in the order of loop.system.inputs
    estimates: FloatArray  # (n, n_coefficients), p̂, in the order of loop.system.coefficients
    # (n, n_coefficients), p̃ = p̂ - p. A continuous run integrates p̃ itself, without loss of
    # digits as it tends to zero.
    parameter_errors: FloatArray
    # (n,), tracked state minus q_d, without loss of digits if it is small
    tracking_error: FloatArray
    settings: dict[str, str | int | float]  # task, tolerances, seed and version
    statistics: dict[str, int]  # accepted and rejected steps
    # (n, n_states), measured states in a sampled run
    measured: FloatArray | None = None

    @cached_property
    def reference(self) -> FloatArray:
        """Reference q_d and its first four derivatives, shape (n, 5)."""
        return np.stack([self.loop.reference.evaluate(self.time, d) for d in range(5)], axis=1)

    def between(self, start: float, stop: float) -> slice:
        """Return the samples in a time window, with both ends."""
        first = int(np.searchsorted(self.time, start - 1e-9))
        return slice(first, int(np.searchsorted(self.time, stop + 1e-9)))

    def final_errors(self) -> dict[str, float]:
        """Return the parameter errors at the end, by coefficient."""
        last = self.parameter_errors[-1]
        return dict(zip(self.loop.system.coefficients, map(float, last), strict=True))

    def largest_tracking_error(self, start: float, stop: float) -> float:
        """Return the largest magnitude of the tracking error in a time window."""
        return float(np.max(np.abs(self.tracking_error[self.between(start, stop)])))

    def log(self) -> dict[str, FloatArray]:
        """Return columns of a log: time, positions, velocities (measured if they are), inputs."""
        columns = {"time": self.time}
        values = self.states if self.measured is None else self.measured
        for place, row in enumerate(self.loop.system.rows):
            columns[f"{row.name}_position"] = values[:, 2 * place]
            columns[f"{row.name}_velocity"] = values[:, 2 * place + 1]
        names = self.loop.system.inputs
        inputs = dict(zip(names, self.inputs.T, strict=True))
        return columns | ({"motor_torque": inputs[names[0]]} if len(names) == 1 else inputs)


def split_columns(kernel: ModuleType, table: FloatArray) -> list[FloatArray]:
    """Split a table into states, inputs, estimates, errors, tracking error and the rest."""
    n = kernel.N_COEFFICIENTS
    widths = (kernel.N_STATES, kernel.N_INPUTS, n, n, 1)
    return np.split(table, np.cumsum(widths), axis=1)


def run_of(
    loop: ClosedLoop,
    kernel: ModuleType,
    time: FloatArray,  # (n,)
    table: FloatArray,  # (n, …), as `split_columns` takes it
    settings: dict[str, Any],
    statistics: dict[str, int],
    *,
    sensed: bool = False,
) -> Run:
    """Return a run from a kernel's table; with `sensed`, its last columns are measured states."""
    *columns, tracking, rest = split_columns(kernel, table)
    return Run(
        loop,
        time,
        *columns,
        tracking_error=tracking[:, 0],
        settings=settings | {"version": flexid.__version__},
        statistics=statistics,
        measured=rest if sensed else None,
    )


_FIRST_STEP = 1e-6
_LONGEST_STEP = 1.0

SIDE_BY_SIDE = 32
"""Non-stiff runs integrated together: eight SIMD vectors of four, or four of eight."""


def simulate(
    loop: ClosedLoop,
    duration: float,
    sample_time: float = 1e-3,
    relative_tolerance: float = 1e-6,
    absolute_tolerance: float | None = None,
    maximum_steps: int = 1_000_000,
) -> Run:
    """Simulate a closed loop in continuous time with Rodas5P, for loops with any gain.

    `Integration` explains the numbers. Raises `SimulationError` if the simulation fails.
    """
    chosen = Integration(
        duration, sample_time, relative_tolerance, absolute_tolerance, maximum_steps
    )
    kernel = loop_kernel(loop.declaration)
    samples = np.empty((1, chosen.count, kernel.SIZE))
    empty = np.empty((1, 0))
    status, reached, variables, counts = integrate_loops(kernel, [loop], chosen, samples, empty)
    if status[0] != kernel.FINISHED:
        largest = float(np.max(np.abs(variables)))
        reason = _reason(kernel, int(status[0]), largest, maximum_steps)
        raise SimulationError(reason, float(reached[0]))
    outputs = np.empty((chosen.count, kernel.N_OUTPUTS))
    kernel.sampled_outputs(sample_time, samples[0], loop.parameters, outputs)
    settings = {"task": "continuous", **asdict(chosen)}
    accepted, rejected, _ = map(int, counts[0])
    statistics = {"accepted_steps": accepted, "rejected_steps": rejected}
    return run_of(loop, kernel, chosen.times, outputs, settings, statistics)


def integrate_loops(
    kernel: ModuleType,
    loops: Sequence[ClosedLoop],
    chosen: Integration,
    samples: FloatArray,  # (n, count or 0, SIZE), filled with the variables at the sample times
    totals: FloatArray,  # (n, N_TOTALS or 0)
) -> tuple[NDArray[np.int64], FloatArray, FloatArray, NDArray[np.int64]]:
    """Integrate n loops of one declaration, without holding the interpreter's lock.

    Returns final status, time and variables, and counts of accepted, rejected and sampled steps.
    """
    runs = len(loops)
    parameters = np.array([loop.parameters for loop in loops])
    variables = np.empty((runs, kernel.SIZE))
    for loop, row, start in zip(loops, parameters, variables, strict=True):
        kernel.start(0.0, np.array(loop.initial_state), loop.start_estimates, row, start)
    status = np.zeros(runs, dtype=np.int64)
    reached = np.zeros(runs)
    counts = np.zeros((runs, 3), dtype=np.int64)
    steps = (
        chosen.relative_tolerance,
        chosen.absolute_tolerance,
        min(_FIRST_STEP, chosen.sample_time),
        _LONGEST_STEP,
        BOUND,
        chosen.maximum_steps,
    )
    kernel.integrate(
        (0.0, chosen.end),
        variables,
        parameters,
        steps,
        (chosen.sample_time, samples),
        totals,
        (status, reached, counts),
    )
    return status, reached, variables, counts


def loop_kernel(declaration: LoopDeclaration, stiff: bool = True) -> ModuleType:
    """Return the compiled functions of a closed loop and its integrator."""

    def build() -> str:
        from flexid.paper.closed_loop import compose_loop, lane_loop_source, stiff_loop_source

        loop = compose_loop(declaration)
        return stiff_loop_source(loop) if stiff else lane_loop_source(loop, SIDE_BY_SIDE)

    templates = ["rodas5p"] if stiff else ["sin_cos", "dopri5"]
    decisive = [*declaration.digests, "" if stiff else f"{SIDE_BY_SIDE} lanes"]
    return load_kernel("closed_loop", decisive, build, templates)


def _reason(kernel: ModuleType, status: int, largest: float, maximum_steps: int) -> str:
    grown = f"its largest coordinate has reached {largest:.3g}"
    if status == kernel.TOO_MANY_STEPS:
        return (
            f"{maximum_steps} steps did not suffice, {grown}: check that the loop is stable, or "
            f"raise maximum_steps"
        )
    if status == kernel.DIVERGED:
        return f"the loop diverges, {grown}: check gains and initial state"
    if status == kernel.NOT_FINITE:
        return f"the equations have no finite value from here on, {grown}: check gains and state"
    return (
        f"no step is small enough for the tolerance, {grown}: loosen relative_tolerance or smooth "
        f"the model"
    )
