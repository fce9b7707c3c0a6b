"""Time per sample of a sampled run: flexid and the same algorithm in hand-written C."""

import ctypes
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.c_observer import BUILDS
from benchmarks.comparison import AtMost, Comparison, Detail, Outcome, Side, duration
from benchmarks.size import sized
from benchmarks.timing import measure
from flexid.arrays import FloatArray
from flexid.paper.laws import pd_gravity
from flexid.simulation.closed_loop import ClosedLoop
from flexid.simulation.sampled import Sampling, simulate_sampled
from flexid.studies.runs import AMPLITUDE, FREQUENCY, table1_loop

SOURCE = Path(__file__).with_name("sampled_loop.c")

_DURATION = sized(30.0, 1.0)
_TICKS = round(1000 * _DURATION) + 1
_IDEAL = Sampling()
_REAL = Sampling(
    input_limit=200.0, position_resolution=1e-4, position_noise=1e-5, velocity_noise=1e-2, seed=7
)
_COLUMNS = 18  # states, input, estimates, their errors, tracking error, measured states


def run(quick: bool) -> Outcome:
    """Compare runs with ideal and with noisy sensors.

    Parameters
    ----------
    quick : bool
        Use fewer repetitions.
    """
    loop = replace(table1_loop((1, 2, 3)), controller=pd_gravity())
    comparisons, lines = [], []
    with tempfile.TemporaryDirectory() as folder:
        for kind, sampling in (("ideal sensors", _IDEAL), ("noise, encoder, limit", _REAL)):
            builds = {
                flags: compile_run(flags, Path(folder), loop, sampling)
                for flags in (*BUILDS, ("-O3", "-DIDEAL_SENSORS"))
                if sampling is _IDEAL or "-DIDEAL_SENSORS" not in flags
            }
            _check(loop, sampling, builds)
            calls = [lambda s=sampling: simulate_sampled(loop, _DURATION, s), *builds.values()]
            own, *others = (
                t.per(_TICKS)
                for t in measure(*calls, repetitions=10 if quick else 100, clock=time.thread_time)
            )
            timings = dict(zip(builds, others, strict=True))
            same = {f: t for f, t in timings.items() if "-DIDEAL_SENSORS" not in f}
            best = min(same, key=lambda flags: same[flags].median)
            comparisons.append(
                Comparison(
                    f"sampled run, 30 s at 1 kHz, {kind}, processor's time per tick",
                    Side("simulate_sampled", own),
                    Side(f"C, gcc {' '.join(best)}", same[best]),
                    AtMost(1.2),
                )
            )
            lines += [(kind, "flexid", duration(own))]
            lines += [(kind, f"gcc {' '.join(f)}", duration(t)) for f, t in timings.items()]
    return Outcome(comparisons, [_table(lines)])


def compile_run(
    flags: tuple[str, ...], folder: Path, loop: ClosedLoop, sampling: Sampling
) -> Callable[[], FloatArray]:
    """Compile the C with gcc for a loop, and return a function that fills a new log at each call.

    NumPy draws the noise in each call, as in flexid.
    """
    library = folder / f"loop{'_'.join(flags)}.so"
    command = ["gcc", "-std=c99", *flags, "-shared", "-fPIC", "-o", str(library), str(SOURCE)]
    subprocess.run([*command, "-lm"], check=True)
    function = ctypes.CDLL(str(library)).run
    pointer, number = ctypes.c_void_p, ctypes.c_double
    function.restype = None
    function.argtypes = [ctypes.c_size_t, number, pointer, number, pointer, number, number]
    function.argtypes += [pointer, pointer, number, number, number, pointer]
    p = loop.controller.parameters
    names = ("nominal_gravity_torque", "nominal_joint_stiffness", "proportional", "derivative")
    law = np.array([*(p[n] for n in names), AMPLITUDE, FREQUENCY, sampling.input_limit])
    true, start = loop.true_coefficients, loop.start_estimates

    def call() -> FloatArray:
        noise = sampling.noise(_TICKS, 4)
        log = np.empty((_TICKS, _COLUMNS))
        function(
            _TICKS,
            sampling.sample_time,
            true.ctypes.data,
            loop.system.constants["beta1"],
            law.ctypes.data,
            loop.observer_gains["link"],
            loop.observer_gains["motor"],
            start.ctypes.data,
            noise.ctypes.data if len(noise) else None,
            sampling.position_noise,
            sampling.velocity_noise,
            sampling.position_resolution,
            log.ctypes.data,
        )
        return log

    return call


def _check(
    loop: ClosedLoop, sampling: Sampling, builds: dict[tuple[str, ...], Callable[[], FloatArray]]
) -> None:
    """Check that both give the same results."""
    run = simulate_sampled(loop, _DURATION, sampling)
    for call in builds.values():
        log = call()
        np.testing.assert_allclose(log[:, :4], run.states, atol=1e-6)
        np.testing.assert_allclose(log[:, 9:13], run.parameter_errors, atol=1e-4)


def _table(lines: list[tuple[str, str, str]]) -> Detail:
    return Detail(
        "Sampled run: ways to compile the C",
        ("sensors", "build", "processor's time per tick"),
        lines,
        "Controller, observer, one Runge-Kutta step and a log of 18 numbers per tick; C and flexid "
        "allocate their logs, and draw their noise, in each call. -DIDEAL_SENSORS leaves the "
        "sensors' model out of the C: then gcc sees that controller, observer and plant look at "
        "the same angle, and takes one sine fewer. flexid's time includes making a `Run`.",
    )
