"""Check that every benchmark runs: ``python -m benchmarks.smoke [NAME ...]`` in a clone.

Each runs with its smallest size in a separate process, one per core, in a copy of the clone, so
that no page and no result changes. The measured values have no meaning.
"""

import argparse
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from benchmarks.__main__ import NAMES
from benchmarks.size import SMOKE

_FOLDERS = ("benchmarks", "docs", "examples", "experiments", "tests")
_ROWS = 8000  # of the example log
_SHOWN = 3000  # characters of a failing benchmark's output that are shown
_MOST_SECONDS = 600  # of one benchmark


@dataclass(frozen=True)
class Job:
    """A benchmark: module, arguments, and the packages and programs that it needs."""

    module: str
    arguments: str = ""
    packages: tuple[str, ...] = ()
    programs: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the job: module and arguments."""
        return f"{self.module} {self.arguments}".strip()

    @property
    def missing(self) -> list[str]:
        """Needed packages and programs that are not installed."""
        packages = [name for name in self.packages if importlib.util.find_spec(name) is None]
        return packages + [name for name in self.programs if shutil.which(name) is None]


JOBS = (
    Job("identify"),
    Job("arms", "--arms 1", ("mujoco",)),
    Job("watching", "--seeds 1"),
    Job("studio", "--windows 1", ("starlette",)),
    Job("drive", "--fuzz 1", programs=("arm-none-eabi-gcc", "qemu-system-arm", "clang")),
    Job("accuracy", "--quick --log 'noise × 1' numpy"),
    Job("campaign"),
    Job("closed_loop"),
    Job("comparing", "--seeds 1 --family basic --kept kept"),
    Job("coverage", "--seeds 2"),
    Job("drifting", "--seeds 1"),
    Job("emps"),
    Job("ensemble"),
    Job("estimator_accuracy"),
    Job("filter_limits"),
    Job("fuzz", "--seconds 1 'model file'"),
    Job("growth"),
    Job("integration", "--seeds 1 --family basic"),
    Job("mutants", "names.py --sample 1"),
    Job("observer", programs=("gcc",)),
    Job("one_clock"),
    Job("online", "--seeds 1"),
    Job("prediction_error"),
    Job("prediction_error_growth"),
    Job("rivals", "--seeds 1 --family basic --tool least_squares --out rivals.json"),
    Job("sampled_loop", programs=("gcc",)),
    Job("sines", "1"),
    Job("streaming"),
    Job("thresholds", "--seeds 1 --family basic --jobs 1"),
    Job("trials", "--seeds 1 --family basic --jobs 1"),
    Job("uneven"),
)
"""All jobs, long ones first. Benchmarks of `python -m benchmarks` run through that command."""


def main() -> None:
    """Run the jobs, print a line for each, and exit with 1 if one failed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.smoke", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    names: Sequence[str] = parser.parse_args().names
    jobs = [job for job in JOBS if not names or job.module in names]
    begun = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
        for name in _FOLDERS:
            shutil.copytree(name, Path(folder) / name)
        example = Path(folder) / "examples" / "flexible_joint.csv"
        example.write_text("\n".join(example.read_text().splitlines()[:_ROWS]) + "\n")
        right = list(pool.map(lambda job: _runs(job, Path(folder)), jobs))
    print(f"{time.perf_counter() - begun:.0f} s in all")
    sys.exit(0 if all(right) else 1)


def _runs(job: Job, folder: Path) -> bool:
    """Run a job; return False if it fails, and True if it succeeds or cannot run here."""
    if job.missing:
        print(f"{job.name}: left out, {', '.join(job.missing)} is not installed", flush=True)
        return True
    if job.module in NAMES:
        command = ["benchmarks", job.module, "--quick"]
    else:
        command = [f"benchmarks.{job.module}", *shlex.split(job.arguments)]
    helpers = [folder / "tests", folder / "tests" / "estimators"]
    path = os.pathsep.join(map(str, [folder, *helpers, *filter(None, [_PATH])]))
    begun = time.perf_counter()
    try:
        done = subprocess.run(
            [sys.executable, "-m", *command],
            cwd=folder,
            env=os.environ | {SMOKE: "yes", "OMP_NUM_THREADS": "1", "PYTHONPATH": path},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=_MOST_SECONDS,
            text=True,
        )
        fault = done.stdout[-_SHOWN:] if done.returncode else ""
    except subprocess.TimeoutExpired:
        fault = f"not done after {_MOST_SECONDS} s"
    outcome = f"FAILS\n{fault}" if fault else "runs"
    print(f"{job.name}: {time.perf_counter() - begun:.1f} s, {outcome}", flush=True)
    return not fault


_PATH = os.environ.get("PYTHONPATH", "")


if __name__ == "__main__":
    main()
