"""`flexid identify` on 30 000 samples: its least squares, the whole command, its parts."""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from benchmarks.comparison import AtMost, Comparison, Detail, Outcome, Side, duration
from benchmarks.timing import Timing, measure
from flexid.estimators.filter_rate import choose_filter_rate
from flexid.estimators.samples import samples_of_recording
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.identification.identify import identify
from flexid.identification.observer_stream import stream
from flexid.models.flexible_joint import flexible_joint
from flexid.recording.read import read_log
from flexid.recording.velocities import with_velocities
from flexid.report.identification_figures import save_identification_figures

LOG = Path("examples/flexible_joint.csv")

_THREADS = (1, 2)

# The last one is imported by flexid only where velocities are missing, as they are in this log.
_IMPORTS = (
    "import flexid.cli.main, flexid.identification.identify, flexid.recording.read, scipy.signal"
)


def run(quick: bool) -> Outcome:
    """Compare batch least squares with `lstsq`; time the command and what it consists of.

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
    """Wall time of the whole command in fresh processes, and of its parts in this one."""
    command = (str(Path(sys.executable).with_name("flexid")), "identify", str(LOG))
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "results"

        def process(*command: str) -> Callable[[], object]:
            quiet = subprocess.DEVNULL
            return lambda: subprocess.run(command, check=True, stdout=quiet, stderr=quiet)

        log = read_log(LOG)
        piece = with_velocities(log.pieces[0])
        samples, system = [samples_of_recording(piece)], flexible_joint()
        rate = choose_filter_rate(samples, system)
        result = identify([log])
        calls: dict[str, Callable[[], object]] = {
            f"`flexid identify {LOG} --out DIR`, whole": process(*command, "--out", str(out)),
            f"`flexid identify {LOG} --json`, whole": process(*command, "--json"),
            "the imports of the latter, whole": process(sys.executable, "-c", _IMPORTS),
            "read and check the log": lambda: read_log(LOG),
            "identify, all of it": lambda: identify([log]),
            "· derive velocities": lambda: with_velocities(log.pieces[0]),
            "· choose the filter rate": lambda: choose_filter_rate(samples, system),
            "· least squares once": lambda: filtered_least_squares(samples, system, rate),
            "· the paper's observer": lambda: stream([piece], system, "zero"),
            "draw and save the figures": lambda: save_identification_figures(result, Path(folder)),
        }
        timings = measure(*calls.values(), repetitions=repetitions)
    return Detail(
        "`flexid identify` on 30 000 samples, kernels cached",
        ("part", "time"),
        [(name, duration(timing)) for name, timing in zip(calls, timings, strict=True)],
        "The lines marked whole are processes of their own, imports included; the others run in "
        "this process, those with a dot within the line above them. What is left is done "
        "once per process: Pint reads its units, Numba loads the kernels.",
    )


def _count(threads: int) -> str:
    return f"{threads} thread{'s' if threads > 1 else ''}"
