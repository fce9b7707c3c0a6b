"""Continuous closed loops, stiff or not, to a stated tolerance."""

from types import ModuleType

import numpy as np
from numpy.typing import NDArray

import flexid
from flexid.control.loop import LoopDeclaration
from flexid.errors import SettingError, SimulationError
from flexid.kernels.store import load_kernel
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
    plain_coordinates: bool = False,
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
    plain_coordinates : bool, optional
        Integrate x and the observer's own states, Huang (2003), eqs. (1) to (3) as they stand: an
        independent check, a hundred times slower at high gain and less accurate.

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
    AccelerationError
        If the observer of the model needs an acceleration; a sampled loop does not.
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
    kernel = loop_kernel(loop.declaration, plain_coordinates)
    parameters = loop.parameters
    final = np.empty(kernel.SIZE)
    kernel.start(0.0, np.array(loop.initial_state), loop.start_estimates, parameters, final)
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
    task = "continuous, plain coordinates" if plain_coordinates else "continuous"
    if status != kernel.FINISHED:
        largest = float(np.max(np.abs(final)))
        raise SimulationError(_reason(kernel, status, largest, maximum_steps), reached)
    return _run(loop, kernel, samples, {"task": task, **settings}, counts)


def loop_kernel(declaration: LoopDeclaration, plain_coordinates: bool = False) -> ModuleType:
    """Compiled functions of a closed loop with its stiff integrator."""

    def build() -> str:
        from flexid.derivation.loop_source import closed_loop_source, plain_loop_source

        return (plain_loop_source if plain_coordinates else closed_loop_source)(declaration)

    task = "plain_closed_loop" if plain_coordinates else "closed_loop"
    return load_kernel(task, declaration.digests, build, ["rodas5p", "loop_outputs"])


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
