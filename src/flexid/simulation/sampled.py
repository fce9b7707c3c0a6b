"""Sampled-data closed loops: what a real drive does.

Controller and observer see the sensors once per sample time; the input is limited and held until
the next sample, while the plant moves on continuously.
"""

from dataclasses import asdict, dataclass
from types import ModuleType

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError, SimulationError
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.paper.loop import LoopDeclaration
from flexid.simulation.closed_loop import ClosedLoop, Run, SampleGrid, run_of

STEPS_PER_TIME_CONSTANT = 20.0
"""Steps of the integrator per time constant of the fastest pole; it then errs by 3e-9 per step."""

_MOST_SUBSTEPS = 1000  # per sample


def runge_kutta_substeps(
    system: ParametricSystem,
    x: FloatArray,
    u: FloatArray,
    p: FloatArray,
    c: FloatArray,
    sample_time: float,
) -> int:
    """Steps per sample that resolve a model's fastest pole."""
    fastest = fastest_pole(system, x, u, p, c)
    substeps = max(1.0, np.ceil(STEPS_PER_TIME_CONSTANT * fastest * sample_time))
    if substeps > _MOST_SUBSTEPS:
        raise SimulationError(
            f"the model has a pole of {fastest:.3g} 1/s, too fast for samples {sample_time:.3g} s "
            f"apart: check its coefficients",
            0.0,
        )
    return int(substeps)


def fastest_pole(
    system: ParametricSystem, x: FloatArray, u: FloatArray, p: FloatArray, c: FloatArray
) -> float:
    """Largest magnitude of a model's poles in 1/s, linearised at the start and at rest."""
    model, fastest = plain_model(system), 0.0
    # Smoothed friction is steepest at rest, a hardening spring where the motion starts.
    for at in [np.zeros_like(x), x] if np.any(x) else [x]:
        matrix, gains = np.empty((len(x), len(x))), np.empty((len(x), len(u)))
        jumps = np.empty(len(x) // 2)
        with np.errstate(all="ignore"):
            model.slopes(at, u, p, c, matrix, gains)
            model.jumps(at, u, p, c, jumps)
        for row in np.flatnonzero(jumps).tolist():
            raise SimulationError(
                f"the acceleration of the model's row {row + 1} jumps with the sign of its "
                f"velocity: smooth it, for example tanh(v/0.01) instead of sign(v)",
                0.0,
            )
        if np.all(np.isfinite(matrix)):  # else the model has no linearisation here
            fastest = max(fastest, float(np.max(np.abs(np.linalg.eigvals(matrix)))))
    return fastest


def plain_model(system: ParametricSystem) -> ModuleType:
    """``right_hand_side``, ``slopes`` and ``jumps`` of a system, as Python."""

    def build() -> str:
        from flexid.derivation.model_functions import plain_model as source

        return source(system)

    return load_kernel("plain_model", [system.digest], build)


@dataclass(frozen=True)
class Sampling:
    """How a loop is sampled and measured."""

    sample_time: float = 1e-3  # in s
    input_limit: float = np.inf  # largest magnitude of an input, in its unit
    position_resolution: float = 0.0  # encoder step in rad; 0 for an ideal one
    position_noise: float = 0.0  # standard deviation of white noise in rad, before quantisation
    velocity_noise: float = 0.0  # the same of the velocities in rad/s
    seed: int = 0  # seed of the noise

    def __post_init__(self) -> None:
        for name in ("sample_time", "input_limit"):
            if not getattr(self, name) > 0:
                raise SettingError(name, f"{getattr(self, name)!r} must be positive")
        for name in ("position_resolution", "position_noise", "velocity_noise"):
            if not 0.0 <= getattr(self, name) < np.inf:
                raise SettingError(name, f"{getattr(self, name)!r} must be zero or positive")

    def noise(self, count: int, states: int) -> FloatArray:
        """Standard normal numbers behind the noise, (count, states), or no rows without noise.

        Drawing them takes about a third of the time of a run.
        """
        if self.position_noise == self.velocity_noise == 0.0:
            return np.empty((0, states))
        return np.random.default_rng(self.seed).standard_normal((count, states))


def simulate_sampled(loop: ClosedLoop, duration: float, sampling: Sampling | None = None) -> Run:
    """Simulate a closed loop with a sampled controller and a sampled observer.

    The run has the true and the measured states; its statistics count the samples at which the
    input was limited.
    """
    sampling = sampling or Sampling()
    grid = SampleGrid(duration, sampling.sample_time)
    kernel = sampled_kernel(loop.declaration)
    record = np.empty((grid.count, kernel.N_RECORD))
    status, taken, limited = run_sampled(kernel, loop, sampling, grid, record, np.empty(0))
    if status != kernel.FINISHED:
        raise SimulationError(
            "the sampled loop diverges: lower its gains or its sample time",
            (taken - 1) * sampling.sample_time,
        )
    settings = {"task": "sampled", "duration": duration, **asdict(sampling)}
    statistics = {"limited_samples": limited}
    return run_of(loop, kernel, grid, record, settings, statistics, sensed=True)


def run_sampled(
    kernel: ModuleType,
    loop: ClosedLoop,
    sampling: Sampling,
    grid: SampleGrid,
    record: FloatArray,  # (count or 1, N_RECORD)
    totals: FloatArray,  # (N_MEASURES or 0,)
) -> tuple[int, int, int]:
    """Status of a sampled run in compiled code, samples taken, samples with the input limited."""
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
            sampling.noise(grid.count, kernel.N_STATES),
            *noise,
            float(sampling.position_resolution),
        ),
        (sampling.input_limit, substeps),
        (loop.start_estimates, np.array([h, 1.0, *gains, *constants])),  # 1: inputs are held
        grid.count,
        record,
        totals,
    )


def sampled_kernel(declaration: LoopDeclaration) -> ModuleType:
    """Compiled functions of a sampled loop."""

    def build() -> str:
        from flexid.paper.sampled_loop import sampled_loop_source

        return sampled_loop_source(declaration)

    return load_kernel("sampled_loop", declaration.digests, build, ["sin_cos", "sampled_loop"])
