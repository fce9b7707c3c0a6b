"""Times of `flexid identify` on 30 000 samples: least squares, whole command, and parts."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

from benchmarks.comparison import AtMost, Comparison, Detail, Outcome, Side, duration
from benchmarks.size import sized
from benchmarks.timing import Timing, measure
from flexid.identification.identify import identify
from flexid.kernels.store import CACHE_VARIABLE
from flexid.recording.read import read_log
from flexid.recording.recording import Log

LOG = Path("examples/flexible_joint.csv")

_THREADS = sized((1, 2), (1,))

# Minimum time of any such command: its imports, and the start of Numba by one call.
_FLOOR = """
import flexid.cli.main, flexid.identification.identify, flexid.recording.read
import polars, rich.console
from flexid.identification.preparation.joint import flexible
from flexid.simulation.free_run import free_run
system = flexible().smooth
free_run(system, dict.fromkeys(system.coefficients, 1.0), [0.0] * 4, [0.0] * 10, 1e-3)
"""


def run(quick: bool) -> Outcome:
    """Compare batch least squares with `lstsq`; time the command and its parts.

    Parameters
    ----------
    quick : bool
        Fewer repetitions.
    """
    results = {threads: _batch(threads, 20 if quick else 200) for threads in _THREADS}
    comparisons = [
        Comparison(
            "batch least squares, 30 001 samples",
            Side(f"from raw positions, {_count(threads)}", result["filtered_least_squares"]),
            Side(f"NumPy lstsq on ready regressors, {_count(threads)}", result["lstsq"]),
            AtMost(3),
        )
        for threads, result in results.items()
    ]
    return Outcome(comparisons, [_batch_table(results), _command_table(2 if quick else 7)])


def _batch(threads: int, repetitions: int) -> dict[str, Timing]:
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.batch", str(repetitions)],
        check=True,
        stdout=subprocess.PIPE,
        env=os.environ | {"OPENBLAS_NUM_THREADS": str(threads)},
    )
    return {name: Timing(**timing) for name, timing in json.loads(done.stdout).items()}


def _batch_table(results: dict[int, dict[str, Timing]]) -> Detail:
    return Detail(
        "Batch least squares: its parts",
        ("part", *(_count(threads) for threads in _THREADS)),
        [
            (part, *(duration(results[threads][part]) for threads in _THREADS))
            for part in ("filtered_least_squares", "filtered_signals", "lstsq")
        ],
        "`filtered_signals` is the part of `filtered_least_squares` that turns positions into "
        "regressors; `lstsq` is given these and has no covariance to compute.",
    )


def _command_table(repetitions: int) -> Detail:
    """Measure wall times of commands in fresh processes, and of the parts of `identify` here."""
    flexid = str(Path(sys.executable).with_name("flexid"))
    log = read_log(LOG)
    with tempfile.TemporaryDirectory() as folder:
        out = str(Path(folder) / "results")

        def process(*command: str) -> Callable[[], object]:
            quiet = subprocess.DEVNULL
            return lambda: subprocess.run(command, check=True, stdout=quiet, stderr=quiet)

        calls: dict[str, Callable[[], object]] = {
            "`flexid --help`, whole": process(flexid, "--help"),
            f"`flexid identify {LOG} --out DIR`, whole": process(
                flexid, "identify", str(LOG), "--out", out
            ),
            f"`flexid identify {LOG}`, whole": process(flexid, "identify", str(LOG)),
            "its imports and one call of a compiled kernel, whole": process(
                sys.executable, "-c", _FLOOR
            ),
            "read and check the log": lambda: read_log(LOG),
            "identify, all of it": lambda: identify([log]),
        }
        calls = sized(calls, dict([*calls.items()][-2:]))
        timings = measure(*calls.values(), repetitions=repetitions)
    lines = [(name, duration(timing)) for name, timing in zip(calls, timings, strict=True)]
    if sized(True, False):  # it takes a quarter of a minute
        first = f"`flexid identify {LOG}`, whole, with an empty cache"
        lines.insert(0, (first, duration(Timing.of([_first_run(flexid)]))))
    steps = [_steps(log) for _ in range(sized(repetitions, 1))]
    lines += [
        (f"· {name}", duration(Timing.of([step[name] for step in steps]))) for name in steps[0]
    ]
    return Detail(
        "`flexid identify` on 30 000 samples, kernels cached but for the empty cache",
        ("part", "time"),
        lines,
        "The lines marked whole are processes of their own, imports included; the others run in "
        "this process, those with a dot within the line above them.",
    )


def _first_run(flexid: str) -> float:
    """Return the time of the command with an empty cache, in s."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        environment = os.environ | {CACHE_VARIABLE: folder}
        subprocess.run(
            [flexid, "identify", str(LOG)], check=True, capture_output=True, env=environment
        )
        return time.perf_counter() - start


def _steps(log: Log) -> dict[str, float]:
    """Return the time of each kind of step of an identification, in s."""
    steps = []
    identify([log], progress=lambda step: steps.append((step, time.perf_counter())))
    end = time.perf_counter()
    taken: dict[str, float] = {}
    for (step, start), (_, stop) in pairwise([*steps, ("", end)]):
        kind = step.split(":")[0].split(" of ")[0].split(" smoothed")[0]
        taken[kind] = taken.get(kind, 0.0) + stop - start
    return taken


def _count(threads: int) -> str:
    return f"{threads} thread{'s' if threads > 1 else ''}"
