"""Many logs in several processes, kept in a JSON file."""

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
"""``runs``, one entry for each command, and ``records``, one for each log."""

Task = tuple[str, int, bool]
"""Family, seed, and whether to identify it with its structure given as well."""


def run(tasks: Sequence[Task], jobs: int, command: str, out: Path | None) -> Results:
    """Identify and record logs.

    Parameters
    ----------
    tasks : sequence of Task
    jobs : int
        Processes; each computes with one thread.
    command : str
        For the record.
    out : Path or None
        Written now and then, so that a run that is broken off keeps what it has.

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
    """Several results as one; of a log that is in two of them, the later record counts."""
    records = {(r["family"], r["seed"]): r for part in parts for r in part["records"]}
    runs = [about for part in parts for about in part["runs"]]
    return {
        "runs": [about for i, about in enumerate(runs) if about not in runs[:i]],
        "records": [records[key] for key in sorted(records)],
    }


def text(results: Results) -> str:
    """JSON with a line for each run and each log."""
    lines = {
        key: ",\n".join(json.dumps(item, ensure_ascii=False) for item in results[key])
        for key in ("runs", "records")
    }
    return f'{{"runs": [\n{lines["runs"]}\n],\n"records": [\n{lines["records"]}\n]}}\n'


def read(path: Path) -> Results:
    """Results from a file."""
    return json.loads(path.read_text(encoding="utf-8"))


def _records(tasks: Sequence[Task], jobs: int) -> Iterator[dict[str, Any]]:
    for variable in _THREADS:
        os.environ[variable] = "1"  # a new process reads it before it loads anything
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
    family, seed, _ = task  # the generator failed, or the whole process
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
    """Short name of the commit that is checked out, marked where files were changed since."""
    command = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    try:
        found = subprocess.run(command, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found.stdout.strip()
