"""Continuous closed loops, stiff or not, to a stated tolerance."""

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

import flexid
from flexid.control.loop import LoopDeclaration
from flexid.errors import SettingError, SimulationError
from flexid.kernels.store import load_kernel, template
from flexid.simulation.loop import ClosedLoop
from flexid.simulation.run import Run

DIVERGED_BEYOND = 1e12
"""Magnitude of a coordinate at which a run counts as diverged: an angle has lost its digits."""

_FIRST_STEP = 1e-6
_LONGEST_STEP = 1.0


def simulate(
    loop: ClosedLoop,
    duration: float,
    sample_time: float = 1e-3,
    relative_tolerance: float = 1e-6,
    absolute_tolerance: float | None = None,
    maximum_steps: int = 1_000_000,
) -> Run:
    """Simulate a closed loop in continuous time.

    Parameters
    ----------
    loop : ClosedLoop
        What to simulate.
    duration : float
        In s; the run ends at the last sample within it.
    sample_time : float, optional
        Distance of the samples of the result in s; the integrator chooses its own steps.
    relative_tolerance : float, optional
        Error allowed per step in each coordinate and each parameter error, relative to its value.
    absolute_tolerance : float, optional
        The same in absolute terms, in SI units; a thousandth of the relative one by default.
    maximum_steps : int, optional
        Steps, accepted and rejected, after which the run is given up.

    Returns
    -------
    Run
        Sampled from 0 on.

    Raises
    ------
    SimulationError
        If the run cannot meet its tolerance, with the time it reached: the loop diverges or is
        stiffer than the steps allow.
    SettingError
        If a duration, sample time or tolerance is not positive.
    """
    if absolute_tolerance is None:
        absolute_tolerance = 1e-3 * relative_tolerance
    settings = {
        "duration": duration,
        "sample_time": sample_time,
        "relative_tolerance": relative_tolerance,
        "absolute_tolerance": absolute_tolerance,
        "maximum_steps": maximum_steps,
    }
    for name, value in settings.items():
        if not 0.0 < value < np.inf:
            raise SettingError(name, f"{value!r} must be a positive number")
    kernel = loop_kernel(loop.declaration)
    parameters = loop.parameters
    final = initial_coordinates(loop, kernel)
    count = int(np.floor(duration / sample_time * (1.0 + 1e-12))) + 1
    samples = np.empty((count, kernel.SIZE))
    counts = np.zeros(3, dtype=np.int64)
    status, reached = kernel.integrate(
        0.0,
        (count - 1) * sample_time,
        final,
        parameters,
        relative_tolerance,
        np.full(kernel.SIZE, absolute_tolerance),
        min(_FIRST_STEP, sample_time),
        _LONGEST_STEP,
        DIVERGED_BEYOND,
        maximum_steps,
        sample_time,
        samples,
        counts,
    )
    if status != kernel.FINISHED:
        largest = float(np.max(np.abs(final)))
        raise SimulationError(_reason(kernel, status, largest, maximum_steps), reached)
    return _run(loop, kernel, samples, {"task": "continuous", **settings}, counts)


def loop_kernel(declaration: LoopDeclaration) -> ModuleType:
    """Compiled functions of a closed loop with its stiff integrator."""

    def build() -> str:
        from flexid.derivation.closed_loop import closed_loop_source

        parts = (closed_loop_source(declaration), template("rodas5p"), template("loop_outputs"))
        return "\n".join(parts)

    return load_kernel("closed_loop", declaration.digests, build)


def initial_coordinates(loop: ClosedLoop, kernel: ModuleType) -> NDArray[np.float64]:
    """Coordinates and parameter errors of the composed loop at time 0."""
    initial = np.zeros(kernel.SIZE)
    kernel.coordinates_of(0.0, np.array(loop.initial_state), loop.parameters, initial)
    initial[kernel.N_STATES :] = loop.start_estimates - loop.true_coefficients
    return initial


def _run(
    loop: ClosedLoop,
    kernel: ModuleType,
    samples: NDArray[np.float64],
    settings: dict[str, str | int | float],
    counts: NDArray[np.int64],
) -> Run:
    sample_time = float(settings["sample_time"])
    time = sample_time * np.arange(len(samples), dtype=np.float64)
    blocks = (kernel.N_STATES, kernel.N_INPUTS, kernel.N_COEFFICIENTS, kernel.N_COEFFICIENTS)
    outputs = np.empty((len(samples), sum(blocks) + 1))
    kernel.sampled_outputs(sample_time, samples, loop.parameters, outputs)
    states, inputs, estimates, errors, tracking = np.split(outputs, np.cumsum(blocks), axis=1)
    return Run(
        loop,
        time,
        states,
        inputs,
        estimates,
        errors,
        np.stack([loop.reference.evaluate(time, order) for order in range(5)], axis=1),
        tracking[:, 0],
        {**settings, "version": flexid.__version__},
        {"accepted_steps": int(counts[0]), "rejected_steps": int(counts[1])},
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
