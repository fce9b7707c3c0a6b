"""Continuous closed loops, integrated to a stated tolerance."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

import flexid
from flexid.arrays import FloatArray
from flexid.control.loop import LoopDeclaration
from flexid.errors import SimulationError
from flexid.kernels.store import load_kernel
from flexid.kernels.templates.run_status import BOUND
from flexid.simulation.loop import ClosedLoop, Run, SampleGrid, check_positive, split_columns

_FIRST_STEP = 1e-6
_LONGEST_STEP = 1.0

SIDE_BY_SIDE = 32
"""Runs of a loop that is not stiff that go side by side: eight vectors of four, four of eight."""


def simulate(
    loop: ClosedLoop,
    duration: float,  # in s; the run ends at the last sample within it
    sample_time: float = 1e-3,  # in s, of the result; the integrator chooses its own steps
    relative_tolerance: float = 1e-6,  # per step, of each coordinate and each parameter error
    absolute_tolerance: float | None = None,  # in SI units; a thousandth of the relative one
    maximum_steps: int = 1_000_000,  # accepted and rejected, after which the run is given up
) -> Run:
    """Simulate a closed loop in continuous time, sampled from 0 on; `SimulationError` if it fails.

    By Rodas5P, good for any gain.
    """
    tolerance = Tolerance(relative_tolerance, absolute_tolerance, maximum_steps)
    grid = SampleGrid(duration, sample_time)
    kernel = loop_kernel(loop.declaration)
    samples = np.empty((1, grid.count, kernel.SIZE))
    ends = integrate_loops(kernel, [loop], grid, tolerance, samples, np.empty((1, 0)))
    if ends.status[0] != kernel.FINISHED:
        largest = float(np.max(np.abs(ends.variables)))
        reason = _reason(kernel, int(ends.status[0]), largest, maximum_steps)
        raise SimulationError(reason, float(ends.reached[0]))
    settings = {"task": "continuous", **asdict(grid), **asdict(tolerance)}
    return _run(loop, kernel, grid, samples[0], settings, ends)


@dataclass(frozen=True)
class Tolerance:
    """How accurately a loop is integrated; the absolute tolerance follows from the relative one."""

    relative_tolerance: float
    absolute_tolerance: float | None
    maximum_steps: int

    def __post_init__(self) -> None:
        if self.absolute_tolerance is None:
            object.__setattr__(self, "absolute_tolerance", 1e-3 * self.relative_tolerance)
        check_positive(asdict(self))


@dataclass(frozen=True)
class Ends:
    """How n runs ended: status, time, variables, and steps: accepted, rejected, sampled."""

    status: NDArray[np.int64]
    reached: FloatArray
    variables: FloatArray
    counts: NDArray[np.int64]


def integrate_loops(
    kernel: ModuleType,
    loops: Sequence[ClosedLoop],
    grid: SampleGrid,
    tolerance: Tolerance,
    samples: FloatArray,  # (n, count or 0, SIZE), filled with the variables at the grid's instants
    totals: FloatArray,  # (n, N_TOTALS or 0)
) -> Ends:
    """Integrate n loops of one declaration; other threads can run meanwhile."""
    runs = len(loops)
    parameters = np.array([loop.parameters for loop in loops])
    variables = np.empty((runs, kernel.SIZE))
    for loop, row, start in zip(loops, parameters, variables, strict=True):
        kernel.start(0.0, np.array(loop.initial_state), loop.start_estimates, row, start)
    status = np.zeros(runs, dtype=np.int64)
    reached = np.zeros(runs)
    counts = np.zeros((runs, 3), dtype=np.int64)
    steps = (
        tolerance.relative_tolerance,
        tolerance.absolute_tolerance,
        min(_FIRST_STEP, grid.sample_time),
        _LONGEST_STEP,
        BOUND,
        tolerance.maximum_steps,
    )
    kernel.integrate(
        (0.0, grid.end),
        variables,
        parameters,
        steps,
        (grid.sample_time, samples),
        totals,
        (status, reached, counts),
    )
    return Ends(status, reached, variables, counts)


def loop_kernel(declaration: LoopDeclaration, stiff: bool = True) -> ModuleType:
    """Compiled functions of a closed loop with its integrator.

    Where it is not stiff, that is an explicit one of many runs side by side, which keeps no
    samples: several times faster as under PD control, and hopeless at high gain.
    """

    def build() -> str:
        from flexid.derivation.closed_loop import compose_loop
        from flexid.derivation.loop_source import lane_loop_source, stiff_loop_source

        loop = compose_loop(declaration)
        return stiff_loop_source(loop) if stiff else lane_loop_source(loop, SIDE_BY_SIDE)

    templates = ["rodas5p"] if stiff else ["sin_cos", "dopri5"]
    decisive = [*declaration.digests, "" if stiff else f"{SIDE_BY_SIDE} lanes"]
    return load_kernel("closed_loop", decisive, build, templates)


def _run(
    loop: ClosedLoop,
    kernel: ModuleType,
    grid: SampleGrid,
    samples: FloatArray,
    settings: dict[str, str | int | float],
    ends: Ends,
) -> Run:
    outputs = np.empty((len(samples), kernel.N_OUTPUTS))
    kernel.sampled_outputs(grid.sample_time, samples, loop.parameters, outputs)
    states, inputs, estimates, errors, tracking, _ = split_columns(kernel, outputs)
    return Run(
        loop,
        grid.times,
        states,
        inputs,
        estimates,
        errors,
        tracking[:, 0],
        {**settings, "version": flexid.__version__},
        {"accepted_steps": int(ends.counts[0, 0]), "rejected_steps": int(ends.counts[0, 1])},
    )


def _reason(kernel: ModuleType, status: int, largest: float, maximum_steps: int) -> str:
    grown = f"its largest coordinate has reached {largest:.3g}"
    if status == kernel.TOO_MANY_STEPS:
        return (
            f"{maximum_steps} steps did not suffice and {grown}: the loop may be unstable, or "
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
