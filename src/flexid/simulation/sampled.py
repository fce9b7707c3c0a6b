"""Sampled-data closed loops: what a real drive does.

Controller and observer see the sensors once per sample time; the input is limited and held until
the next sample, while the plant moves on continuously.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

import flexid
from flexid.control.loop import LoopDeclaration
from flexid.errors import SettingError, SimulationError
from flexid.kernels.store import load_kernel
from flexid.simulation.loop import ClosedLoop
from flexid.simulation.run import Run
from flexid.simulation.substeps import runge_kutta_substeps

Array = NDArray[np.float64]

Law = Callable[[float, Array, Array], ArrayLike]
"""A control law in Python: time, measured states, q_d and its four derivatives to inputs."""


@dataclass(frozen=True)
class Sampling:
    """How a loop is sampled and measured.

    Parameters
    ----------
    sample_time : float, optional
        In s.
    input_limit : float, optional
        Largest magnitude of an input, in its unit.
    position_resolution : float, optional
        Encoder step in rad; 0 for an ideal one.
    position_noise, velocity_noise : float, optional
        Standard deviation of white noise on the measured positions and velocities, in rad and
        rad/s; positions get theirs before they are quantised.
    seed : int, optional
        Seed of the noise.

    Raises
    ------
    SettingError
        If a value is out of its range.
    """

    sample_time: float = 1e-3
    input_limit: float = np.inf
    position_resolution: float = 0.0
    position_noise: float = 0.0
    velocity_noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("sample_time", "input_limit"):
            if not getattr(self, name) > 0:
                raise SettingError(name, f"{getattr(self, name)!r} must be positive")
        for name in ("position_resolution", "position_noise", "velocity_noise"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise SettingError(name, f"{getattr(self, name)!r} must be zero or positive")

    def noise(self, count: int, states: int) -> Array:
        """Noise of all measurements, (count, states): coordinates and velocities in turn."""
        generator = np.random.default_rng(self.seed)
        scale = np.tile([self.position_noise, self.velocity_noise], states // 2)
        return scale * generator.standard_normal((count, states))


def simulate_sampled(
    loop: ClosedLoop, duration: float, sampling: Sampling | None = None, law: Law | None = None
) -> Run:
    """Simulate a closed loop with a sampled controller and a sampled observer.

    Parameters
    ----------
    loop : ClosedLoop
        What to simulate.
    duration : float
        In s; the run ends at the last sample within it.
    sampling : Sampling, optional
        Sample time, limits and sensors; ideal at 1 kHz by default.
    law : callable, optional
        Takes the place of the loop's controller, at the price of speed: a Python call per sample.

    Returns
    -------
    Run
        With the true states, and beside them what was measured. The statistics count the samples
        at which the input was limited.

    Raises
    ------
    SimulationError
        If the loop diverges.
    SettingError
        If the duration is not positive.
    """
    sampling = sampling or Sampling()
    if not 0.0 < duration < np.inf:
        raise SettingError("duration", f"{duration!r} must be a positive number")
    kernel = sampled_kernel(loop.declaration)
    count = int(np.floor(duration / sampling.sample_time * (1.0 + 1e-12))) + 1
    time = sampling.sample_time * np.arange(count, dtype=np.float64)
    reference = np.stack([loop.reference.evaluate(time, order) for order in range(5)], axis=1)
    states = np.empty((count, kernel.N_STATES))
    states[0] = loop.initial_state
    record = _Record(
        states,
        np.empty((count, kernel.N_INPUTS)),
        np.empty_like(states),
        np.empty((count, kernel.N_COEFFICIENTS)),
    )
    if law is None:
        done, limited = _run_compiled(kernel, loop, sampling, record)
    else:
        done, limited = _run_called(kernel, loop, sampling, record, law, reference)
    if done < count or not np.all(np.isfinite(record.estimates)):
        raise SimulationError(
            "the sampled loop diverges: lower its gains or its sample time",
            (done - 1) * sampling.sample_time,
        )
    tracked = loop.system.states.index(loop.controller.tracked)
    settings = {"task": "sampled", "duration": duration, **asdict(sampling)}
    return Run(
        loop,
        time,
        states,
        record.inputs,
        record.estimates,
        record.estimates - loop.true_coefficients,
        reference,
        states[:, tracked] - reference[:, 0],
        settings | {"version": flexid.__version__},
        {"limited_samples": int(limited)},
        record.measured,
    )


@dataclass(frozen=True)
class _Record:
    """What a run fills, one row per sample."""

    states: Array
    inputs: Array
    measured: Array
    estimates: Array


def sampled_kernel(declaration: LoopDeclaration) -> ModuleType:
    """Compiled functions of a sampled loop."""

    def build() -> str:
        from flexid.derivation.sampled_loop import sampled_loop_source

        return sampled_loop_source(declaration)

    templates = ["status", "parametric_observer", "sampled_loop"]
    return load_kernel("sampled_loop", declaration.digests, build, templates)


def _observer_settings(loop: ClosedLoop, sample_time: float) -> Array:
    """Sample time, held input, gains, constants: what the sampled observer is set to."""
    gains = [loop.observer_gains[row.name] for row in loop.system.rows for _ in row.coefficients]
    return np.array([sample_time, 1.0, *gains, *loop.system.constants.values()])


def _constants(loop: ClosedLoop) -> Array:
    return np.array(list(loop.system.constants.values()), dtype=np.float64)


def _substeps(kernel: ModuleType, loop: ClosedLoop, sample_time: float) -> int:
    start = np.array(loop.initial_state)
    still = np.zeros(kernel.N_INPUTS)
    p, c = loop.true_coefficients, _constants(loop)
    return runge_kutta_substeps(kernel, start, still, p, c, sample_time)


def _run_compiled(
    kernel: ModuleType, loop: ClosedLoop, sampling: Sampling, record: _Record
) -> tuple[int, int]:
    return kernel.sampled_run(
        loop.parameters,
        loop.true_coefficients,
        _constants(loop),
        sampling.noise(*record.states.shape),
        sampling.position_resolution,
        sampling.input_limit,
        _substeps(kernel, loop, sampling.sample_time),
        loop.start_estimates,
        _observer_settings(loop, sampling.sample_time),
        record.states,
        record.inputs,
        record.measured,
        record.estimates,
    )


def _run_called(
    kernel: ModuleType,
    loop: ClosedLoop,
    sampling: Sampling,
    record: _Record,
    law: Law,
    reference: Array,
) -> tuple[int, int]:
    """The compiled run step by step, with a Python call where the compiled law would be."""
    h = sampling.sample_time
    noise = sampling.noise(*record.states.shape)
    settings, constants, true = (
        _observer_settings(loop, h),
        _constants(loop),
        loop.true_coefficients,
    )
    observer = np.zeros(kernel.STATE_SIZE)
    observer[1 : 1 + len(true)] = loop.start_estimates
    x = record.states[0].copy()
    substeps = _substeps(kernel, loop, h)
    limited = 0
    for n in range(len(record.states)):
        record.states[n] = x
        seen, u = record.measured[n], record.inputs[n]
        kernel.measure(x, noise[n], sampling.position_resolution, seen)
        u[:] = law(n * h, seen.copy(), reference[n].copy())
        limited += kernel.saturate(u, sampling.input_limit)
        observer, _ = kernel.step(observer, np.concatenate((seen, u)), settings)
        record.estimates[n] = observer[1 : 1 + len(true)]
        kernel.move(x, u, true, constants, h, substeps)
        if not kernel.bounded(x):
            return n + 1, limited
    return len(record.states), limited
