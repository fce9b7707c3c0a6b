"""Overhead of `flexid campaign` with 10 000 runs, besides the compiled runs.

    python -m benchmarks.campaign EXPERIMENT DIR

runs the command on a file and prints two processor times in s as JSON: of the whole process, and of
the compiled integrator in all threads. It is a separate process so that imports count.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.comparison import AtMost, Comparison, Detail, Outcome, Side
from benchmarks.size import sized
from benchmarks.timing import Timing

EXPERIMENT = Path("experiments/huang2003_campaign.toml")

_RUNS = 10_000
_QUICK_RUNS = sized(500, 16)


def run(quick: bool) -> Outcome:
    """Run the campaign once with the command.

    Parameters
    ----------
    quick : bool
        Run fewer, so that the start of the process counts more, and check no goal.
    """
    runs = _QUICK_RUNS if quick else _RUNS
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "campaign.toml", Path(folder) / "out"
        text = EXPERIMENT.read_text(encoding="utf-8")
        path.write_text(text.replace("runs = 1024", f"runs = {runs}"), encoding="utf-8")
        command = [sys.executable, "-m", "benchmarks.campaign", str(path), str(out)]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        written = sum(file.stat().st_size for file in out.glob("runs/*.parquet"))
    spent = json.loads(done.stdout.splitlines()[-1])
    total, compiled = (Timing(spent[part], spent[part], 1) for part in ("total", "compiled"))
    comparison = Comparison(
        f"campaign of {runs} runs, processor's time",
        Side("`flexid campaign`, start, plan and rows included", total),
        Side("within the compiled integrator", compiled),
        None if quick else AtMost(1.1),
    )
    return Outcome([comparison], [_table(runs, spent, written)])


def _table(runs: int, spent: dict[str, float], written: int) -> Detail:
    def line(name: str, seconds: float) -> tuple[str, str, str]:
        return name, f"{seconds:.3g} s", f"{1e3 * seconds / runs:.3g} ms"

    return Detail(
        f"A campaign of {runs} runs of Table I, 30 s each",
        ("part", "in all", "per run"),
        [
            line("wall time", spent["wall"]),
            line("processor's time", spent["total"]),
            line("· within the compiled integrator", spent["compiled"]),
            line("· before the first run: start and imports", spent["start"]),
            line("· the rest: values, rows, files", _rest(spent)),
        ],
        f"On all cores; the rows take {written / 1e6:.2g} MB as Parquet.",
    )


def _rest(spent: dict[str, float]) -> float:
    return spent["total"] - spent["compiled"] - spent["start"]


def main(path: str, out: str) -> None:
    """Run the command in this process and print the processor times."""
    began = time.perf_counter()
    from flexid.cli.main import main as flexid
    from flexid.simulation import ensemble

    start: list[float] = []
    compiled: list[float] = []  # one number per run, as adding up is not safe with threads
    ensemble.loop_kernel = _observed(ensemble.loop_kernel, start, compiled)
    sys.argv = ["flexid", "campaign", path, "--out", out]
    try:
        flexid()
    except SystemExit as end:
        if end.code:
            raise
    total, wall = time.process_time(), time.perf_counter() - began
    spent = {"start": start[0], "compiled": sum(compiled), "total": total, "wall": wall}
    print(json.dumps(spent))


def _observed(
    load: Callable[..., ModuleType], begun: list[float], compiled: list[float]
) -> Callable[..., Any]:
    """Return a kernel loader whose integrators record the processor time of their thread."""
    observed: dict[int, ModuleType] = {}

    def loader(*arguments: Any, **options: Any) -> ModuleType:
        kernel = load(*arguments, **options)
        if id(kernel) not in observed:
            observed[id(kernel)] = kernel
            begun.append(time.process_time())
            integrate = kernel.integrate

            def timed(*values: Any) -> Any:
                start = time.thread_time()
                result = integrate(*values)
                compiled.append(time.thread_time() - start)
                return result

            kernel.integrate = timed  # type: ignore[attr-defined] - a kernel is a module
        return kernel

    return loader


if __name__ == "__main__":
    main(*sys.argv[1:])
