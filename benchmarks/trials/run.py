"""Identify many logs in several processes, with results in a JSON file."""

import datetime
import json
import multiprocessing
import os
import platform
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from importlib.metadata import version
from pathlib import Path
from typing import Any

from benchmarks.report import processor
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.realistic.families import REALISTIC

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_OFTEN = 20  # logs between two writes of the file

Results = dict[str, Any]
"""Entries ``runs``, one for each command, and ``records``, one for each log."""

Task = tuple[str, int, bool]
"""Family, seed, and whether to identify it with its structure given as well."""


def run(tasks: Sequence[Task], jobs: int, command: str, out: Path | None) -> Results:
    """Identify logs and record the results.

    Parameters
    ----------
    tasks : sequence of Task
    jobs : int
        Number of processes, with one thread each.
    command : str
        Command line, stored in the results.
    out : Path or None
        File that is written regularly, so that an interrupted run keeps its results.

    Returns
    -------
    Results
    """
    about: dict[str, Any] = {
        "command": command,
        "date": str(datetime.datetime.now(datetime.UTC).date()),
        "flexid": version("flexid"),
        "commit": commit(),
        "machine": f"{processor()}, {os.cpu_count()} cores, {jobs} at work",
        "python": platform.python_version(),
    }
    results: Results = {"runs": [about], "records": []}
    begun = time.monotonic()
    for count, record in enumerate(_records(tasks, jobs), start=1):
        results["records"].append(record)
        state = record.get("error") or f"{record['seconds']:.1f} s"
        name = f"{record['family']} {record['seed']}"
        print(f"{count} of {len(tasks)}: {name}: {state}", file=sys.stderr)
        if out is not None and (count % _OFTEN == 0 or count == len(tasks)):
            about["seconds"] = round(time.monotonic() - begun)
            out.write_text(text(merged([results])), encoding="utf-8")
    return merged([results])


def merged(parts: Sequence[Results]) -> Results:
    """Merge results; for a log in several of them, the last record counts."""
    records = {(r["family"], r["seed"]): r for part in parts for r in part["records"]}
    runs = [about for part in parts for about in part["runs"]]
    return {
        "runs": [about for i, about in enumerate(runs) if about not in runs[:i]],
        "records": [records[key] for key in sorted(records)],
    }


def text(results: Results) -> str:
    """Return results as JSON with a line for each run and each log."""
    lines = {
        key: ",\n".join(json.dumps(item, ensure_ascii=False) for item in results[key])
        for key in ("runs", "records")
    }
    return f'{{"runs": [\n{lines["runs"]}\n],\n"records": [\n{lines["records"]}\n]}}\n'


def read(path: Path) -> Results:
    """Read results from a file."""
    return json.loads(path.read_text(encoding="utf-8"))


def _records(tasks: Sequence[Task], jobs: int) -> Iterator[dict[str, Any]]:
    for variable in _THREADS:
        os.environ[variable] = "1"  # for new processes, which read it at their start
    with ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn")) as pool:
        futures = {pool.submit(_one, task): task for task in tasks}
        for future in as_completed(futures):
            yield _outcome(future, futures[future])


def _one(task: Task) -> dict[str, Any]:
    from benchmarks.trials.realistic.record import recorded as recorded_realistic
    from benchmarks.trials.record import recorded

    family, seed, _ = task
    return recorded_realistic(family, seed) if family in REALISTIC else recorded(*task)


def _outcome(future: Future[dict[str, Any]], task: Task) -> dict[str, Any]:
    error = future.exception()
    if error is None:
        return future.result()
    family, seed, _ = task  # the generator or the whole process failed
    if family in REALISTIC:
        known: dict[str, Any] = {"realistic": True, "core": []}
    else:
        known = {"in_class": FAMILIES[family].in_class, "terms": []}
    return {
        "family": family,
        "seed": seed,
        **known,
        "truth": {},
        "error": f"{type(error).__name__}: {error}"[:400],
        "refused": False,
    }


def commit() -> str:
    """Return the short hash of the current commit, marked if files have changed."""
    command = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found.stdout.strip()
