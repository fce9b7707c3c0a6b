"""Many runs of one closed loop in compiled code; only final states and measures are stored."""

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError, SimulationError
from flexid.models.parametric_system import ParametricSystem
from flexid.simulation.closed_loop import (
    ClosedLoop,
    Integration,
    integrate_loops,
    loop_kernel,
    split_columns,
)
from flexid.simulation.sampled import Sampling, run_sampled, sampled_kernel

# Outcome of a run by its status number. "step too small": the loop is too stiff for the tolerance
# or sample time. "not finite": the equations have no finite value.
STATUS = ("finished", "too many steps", "step too small", "not finite", "diverged")


@dataclass(frozen=True)
class Ensemble:
    """Final states and measures of n runs, finished or aborted, in SI units."""

    # of one run; gives the order of states, inputs, coefficients and rows
    system: ParametricSystem
    status: NDArray[np.int64]  # (n,), indices into STATUS
    reached: FloatArray  # (n,), time at which each run ended, in s
    final_states: FloatArray  # (n, n_states)
    final_errors: FloatArray  # (n, n_coefficients), p̂ - p at the end
    # (n, n_coefficients), last time at which p̂ differed from p by more than 5 %; NaN if it still
    # did at the end
    settling_time: FloatArray
    tracking_rms: FloatArray  # (n,), root mean square over time of the tracking error, in rad
    tracking_peak: FloatArray  # (n,), its largest magnitude, in rad
    peak_input: FloatArray  # (n, n_inputs), largest magnitude of each input
    # (n, n_rows), condition number of each row's normalised Gram matrix, (A4) of Huang (2003)
    # measured: the mean over time of r rᵀ along the run, scaled to a unit diagonal
    excitation: FloatArray
    steps: NDArray[np.int64]  # (n,), accepted steps of the integrator, or samples


def simulate_ensemble(
    loops: Sequence[ClosedLoop],
    duration: float,
    sample_time: float = 1e-3,
    relative_tolerance: float = 1e-6,
    absolute_tolerance: float | None = None,
    maximum_steps: int = 1_000_000,
    stiff: bool = True,
) -> Ensemble:
    """Simulate many closed loops in continuous time, with measures at the accepted steps."""
    _check(loops)
    chosen = Integration(
        duration, sample_time, relative_tolerance, absolute_tolerance, maximum_steps
    )
    kernel = loop_kernel(loops[0].declaration, stiff)
    totals = np.zeros((len(loops), kernel.N_TOTALS))
    no_samples = np.empty((len(loops), 0, kernel.SIZE))
    status, reached, _, counts = integrate_loops(kernel, loops, chosen, no_samples, totals)
    states, _, _, errors, _, _ = split_columns(kernel, totals[:, kernel.N_MEASURES :])
    measured = _measures(kernel, loops[0].system, totals, reached, reached)
    return Ensemble(loops[0].system, status, reached, states, errors, *measured, counts[:, 0])


def simulate_sampled_ensemble(
    loops: Sequence[ClosedLoop],
    duration: float,
    samplings: Sequence[Sampling],
) -> Ensemble:
    """Simulate many sampled loops as `simulate_sampled` does, with measures at the samples."""
    _check(loops)
    if len(samplings) != len(loops):
        raise SettingError("samplings", f"there are {len(samplings)} for {len(loops)} loops")
    counts = [Integration(duration, sampling.sample_time).count for sampling in samplings]
    kernel = sampled_kernel(loops[0].declaration)
    totals = np.zeros((len(loops), kernel.N_MEASURES))
    record = np.full((len(loops), kernel.N_RECORD), np.nan)
    status, steps = (np.zeros(len(loops), dtype=np.int64) for _ in range(2))
    for place, (loop, sampling) in enumerate(zip(loops, samplings, strict=True)):
        own, row = totals[place], record[place : place + 1]
        try:
            ended = run_sampled(kernel, loop, sampling, counts[place], row, own)
            status[place], steps[place], _ = ended
        except SimulationError:
            status[place] = STATUS.index("step too small")
            own[:] = np.nan
    reached = np.maximum(steps - 1, 0) * [sampling.sample_time for sampling in samplings]
    states, _, _, errors, _, _ = split_columns(kernel, record)
    measured = _measures(kernel, loops[0].system, totals, reached, steps)
    return Ensemble(loops[0].system, status, reached, states, errors, *measured, steps)


def _check(loops: Sequence[ClosedLoop]) -> None:
    if not loops:
        raise SettingError("loops", "the list is empty: give at least one")
    declarations = {id(loop.declaration): loop.declaration for loop in loops}  # most are one
    if len({one.digests for one in declarations.values()}) > 1:
        raise SettingError(
            "loops", "they differ in more than values: simulate each kind of loop separately"
        )


def _measures(
    kernel: ModuleType,
    system: ParametricSystem,
    totals: FloatArray,
    reached: FloatArray,
    weights: FloatArray | NDArray[np.int64],  # divisors of the sums over time
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the fields of an `Ensemble` from `settling_time` to `excitation`."""
    n = kernel.N_COEFFICIENTS
    unsettled = totals[:, kernel.UNSETTLED : kernel.GRAM]
    gram = totals[:, kernel.GRAM : kernel.N_MEASURES].reshape(-1, n, n)
    with np.errstate(all="ignore"):  # a run aborted at once, or with an overflow
        rms = np.sqrt(totals[:, 0] / weights)
        excitation = [_conditions(gram[:, part, part]) for _, part in system.row_slices()]
    return (
        np.where(unsettled < reached[:, np.newaxis], unsettled, np.nan),
        rms,
        totals[:, 1].copy(),
        totals[:, kernel.PEAKS : kernel.UNSETTLED].copy(),
        np.stack(excitation, axis=1),
    )


def _conditions(gram: FloatArray) -> FloatArray:
    """Return the condition number of each normalised Gram matrix from its lower triangle."""
    scale = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
    scale = np.where(scale == 0.0, 1.0, scale)
    normalised = gram / (scale[:, :, np.newaxis] * scale[:, np.newaxis, :])
    conditions = np.full(len(gram), np.nan)
    finite = np.all(np.isfinite(normalised), axis=(1, 2))
    eigenvalues = np.linalg.eigvalsh(normalised[finite])  # reads only the lower triangle
    smallest = eigenvalues[:, 0]  # rounding may make it negative
    ratio = eigenvalues[:, -1] / smallest
    conditions[finite] = np.where(smallest > 0.0, ratio, np.inf)
    return conditions
