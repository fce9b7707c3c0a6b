"""Sampled-data closed loops: a continuous plant with sampled sensors and held inputs."""

from dataclasses import asdict, dataclass
from types import ModuleType

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError, SimulationError
from flexid.kernels.store import load_kernel
from flexid.paper.loop import LoopDeclaration
from flexid.simulation.closed_loop import ClosedLoop, Integration, Run, run_of
from flexid.simulation.free_run import runge_kutta_substeps


@dataclass(frozen=True)
class Sampling:
    """Sample time, input limit and sensor errors of a sampled loop."""

    sample_time: float = 1e-3  # in s
    input_limit: float = np.inf  # largest magnitude of an input, in its unit
    position_resolution: float = 0.0  # encoder step in rad; 0 for an ideal one
    position_noise: float = 0.0  # standard deviation of white noise in rad, before quantisation
    velocity_noise: float = 0.0  # standard deviation of white noise in rad/s
    seed: int = 0  # seed of the noise

    def __post_init__(self) -> None:
        for name in ("sample_time", "input_limit"):
            if not getattr(self, name) > 0:
                raise SettingError(name, f"{getattr(self, name)!r} must be positive")
        for name in ("position_resolution", "position_noise", "velocity_noise"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise SettingError(name, f"{getattr(self, name)!r} must be zero or positive")

    def noise(self, count: int, states: int) -> FloatArray:
        """Return standard normal numbers, shape (count, states), or (0, states) without noise."""
        if self.position_noise == self.velocity_noise == 0.0:
            return np.empty((0, states))
        return np.random.default_rng(self.seed).standard_normal((count, states))


def simulate_sampled(loop: ClosedLoop, duration: float, sampling: Sampling | None = None) -> Run:
    """Simulate a closed loop with a sampled controller and a sampled observer."""
    sampling = sampling or Sampling()
    chosen = Integration(duration, sampling.sample_time)
    kernel = sampled_kernel(loop.declaration)
    record = np.empty((chosen.count, kernel.N_RECORD))
    status, taken, limited = run_sampled(kernel, loop, sampling, chosen.count, record, np.empty(0))
    if status != kernel.FINISHED:
        raise SimulationError(
            "the sampled loop diverges: lower its gains or its sample time",
            (taken - 1) * sampling.sample_time,
        )
    settings = {"task": "sampled", "duration": duration, **asdict(sampling)}
    statistics = {"limited_samples": limited}
    return run_of(loop, kernel, chosen.times, record, settings, statistics, sensed=True)


def run_sampled(
    kernel: ModuleType,
    loop: ClosedLoop,
    sampling: Sampling,
    count: int,  # of samples
    record: FloatArray,  # (count or 1, N_RECORD)
    totals: FloatArray,  # (N_MEASURES or 0,)
) -> tuple[int, int, int]:
    """Run a sampled loop; return status, number of samples, and samples with a limited input."""
    system, h = loop.system, sampling.sample_time
    start, still = np.array(loop.initial_state), np.zeros(len(system.inputs))
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    coefficients = loop.true_coefficients
    substeps = runge_kutta_substeps(system, start, still, coefficients, constants, h)
    gains = [loop.observer_gains[row.name] for row in system.rows for _ in row.coefficients]
    noise = float(sampling.position_noise), float(sampling.velocity_noise)
    return kernel.sampled_run(
        start[np.newaxis],
        loop.parameters[np.newaxis],
        constants,
        (
            sampling.noise(count, kernel.N_STATES),
            *noise,
            float(sampling.position_resolution),
        ),
        (sampling.input_limit, substeps),
        (loop.start_estimates, np.array([h, 1.0, *gains, *constants])),  # 1: inputs are held
        count,
        record,
        totals,
    )


def sampled_kernel(declaration: LoopDeclaration) -> ModuleType:
    """Return the compiled functions of a sampled loop."""

    def build() -> str:
        from flexid.paper.sampled_loop import sampled_loop_source

        return sampled_loop_source(declaration)

    return load_kernel("sampled_loop", declaration.digests, build, ["sin_cos", "sampled_loop"])
