"""Many runs of a closed loop by SciPy in a process pool, and by diffrax's vmap."""

import math
import multiprocessing
import os
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.size import sized
from benchmarks.table1 import AMPLITUDE, KE_N, MGL_N, OMEGA, START, Table1
from flexid.arrays import FloatArray

DURATION = sized(30.0, 1.0)

_FIRST_STEP = 1e-6  # s, for the stiff solvers


@dataclass(frozen=True)
class Plant:
    """One member of the ensemble: k, theta1, theta2, alpha1, alpha2 and beta1."""

    k: float
    true: tuple[float, ...]
    beta1: float


def scipy_run(plain: bool, tolerance: float, plant: Plant) -> tuple[list[float], float]:
    """Solve Table I with gains (1,2,3) with SciPy's Radau.

    Returns
    -------
    list of float
        Final parameter errors.
    float
        Processor time in s.
    """
    loop = Table1((1, 2, 3), k=plant.k, true=plant.true, beta1=plant.beta1)
    rates = loop.plain_rates if plain else loop.error_rates
    start = time.process_time()
    result = solve_ivp(
        lambda t, state: rates(t, state.tolist()),
        (0.0, DURATION),
        loop.plain_start() if plain else loop.error_start(),
        method="Radau",
        t_eval=[DURATION],
        rtol=tolerance,
        atol=1e-3 * tolerance,
    )
    last = result.y[:, -1].tolist()
    errors = loop.plain_errors(last) if plain else last[4:]
    return errors, time.process_time() - start


def scipy_pool(
    plants: Sequence[Plant], plain: bool, tolerance: float, workers: int
) -> tuple[FloatArray, float, float]:
    """Run all plants in an existing pool of processes.

    Returns
    -------
    (n, 4) ndarray
        Final errors.
    float, float
        Wall time of all runs and mean processor time of one, in s.
    """
    job = partial(scipy_run, plain, tolerance)
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        list(pool.map(_warm_up, range(4 * workers)))
        start = time.perf_counter()
        done = list(pool.map(job, plants))
        wall = time.perf_counter() - start
    return np.array([e for e, _ in done]), wall, float(np.mean([cpu for _, cpu in done]))


def _warm_up(_: int) -> None:
    time.sleep(0.05)  # so that every process gets a task


def diffrax_ensemble(
    plants: Sequence[Plant], gains: tuple[float, float] | None, tolerance: float, solver: str
) -> Callable[[], FloatArray]:
    """Compile a solver for all plants as one vmap on the processor.

    Parameters
    ----------
    plants : sequence of Plant
    gains : (float, float) or None
        Proportional and derivative gain of PD control with gravity compensation. If None, Table I
        with gains (1,2,3) in error coordinates.
    tolerance : float
        Relative tolerance; the absolute one is a thousandth of it.
    solver : str
        Name of diffrax's solver.

    Returns
    -------
    callable
        Function that runs all and returns the final errors, (n, 4); compiled at its first call.

    Raises
    ------
    ImportError
        If diffrax is not installed.
    """
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    import diffrax
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)

    def loop(p: Any) -> Table1:
        return Table1((1, 2, 3), jnp.sin, jnp.cos, k=p[0], true=p[1:5], beta1=p[5])

    def field(t: Any, state: Any, p: Any) -> Any:
        rates = loop(p).error_rates(t, state) if gains is None else _pd_rates(t, state, p, gains)
        return jnp.stack(rates)

    def start(p: Any) -> Any:
        if gains is None:
            return jnp.stack([jnp.asarray(value, float) for value in loop(p).error_start()])
        return jnp.concatenate([jnp.zeros(4), jnp.array(START) - p[1:5]])

    def one(p: Any) -> Any:
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            getattr(diffrax, solver)(),
            0.0,
            DURATION,
            None if gains else _FIRST_STEP,
            start(p),
            p,
            saveat=diffrax.SaveAt(t1=True),
            stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=1e-3 * tolerance),
            max_steps=100_000,
        )
        assert solution.ys is not None
        return solution.ys[0, 4:]

    together = jax.jit(jax.vmap(one))
    values = jnp.array([[plant.k, *plant.true, plant.beta1] for plant in plants])
    return lambda: np.asarray(together(values))


def _pd_rates(t: Any, state: Any, p: Any, gains: tuple[float, float]) -> list[Any]:
    """Return the rates of x1 ... x4 and the parameter errors under PD control, eqs. (4) and (7)."""
    import jax.numpy as jnp

    x1, x2, x3, x4, theta1, theta2, alpha1, alpha2 = state
    q, q1 = AMPLITUDE * jnp.sin(OMEGA * t), AMPLITUDE * OMEGA * jnp.cos(OMEGA * t)
    compensation = MGL_N * jnp.sin(q)
    speed = q1 * (1.0 + MGL_N * jnp.cos(q) / KE_N)
    u = gains[0] * (q + compensation / KE_N - x3) + gains[1] * (speed - x4) + compensation
    sine, twist = jnp.sin(x1), x1 - x3
    link, motor = theta1 * sine + theta2 * twist, alpha1 * twist - alpha2 * x4
    return [
        x2,
        -p[1] * sine - p[2] * twist,
        x4,
        p[3] * twist - p[4] * x4 + p[5] * u,
        -sine * link,
        -twist * link,
        -twist * motor,
        x4 * motor,
    ]


def nearness(errors: FloatArray, reference: FloatArray) -> float:
    """Return the largest deviation, relative to the value or to 1e-3 if the value is smaller."""
    deviation = np.abs(errors - reference) / np.maximum(np.abs(reference), 1e-3)
    return float(np.max(deviation)) if np.all(np.isfinite(deviation)) else math.inf
