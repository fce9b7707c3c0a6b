"""Compare flexid with other tools on the same logs: accuracy, intervals, time, user code.

    python -m benchmarks.accuracy [--quick] [--render] [--log KIND] [TOOL ...]

in the root of a clone. All results are stored in `accuracy.json`, from which the tables of
`docs/comparison.md` are made. If tools are named, only they run, on all logs or on the given kinds,
and other results are kept. --render only makes the tables. --quick runs every tool once on every
kind of log and changes no file. A tool that is not installed is left out, with a message.
"""

import argparse
import datetime
import importlib
import importlib.util
import json
import math
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from rich.console import Console

from benchmarks.accuracy_logs import CASES, EXAMPLE, TRUTH, Case
from benchmarks.accuracy_page import BLOCK, PAGE, RESULTS, lines_of_user_code, render
from benchmarks.accuracy_tools import TOOLS, Tool
from benchmarks.page_block import write_block
from benchmarks.peers.problem import Answer, Log
from benchmarks.report import processor
from benchmarks.timing import timed

_STARTS = 3  # runs of the whole command after compilation


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accuracy", description=__doc__)
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--render", action="store_true")
    parser.add_argument("--log", action="append", choices=[case.name for case in CASES])
    parser.add_argument("tools", nargs="*", metavar="TOOL", help=", ".join(t.key for t in TOOLS))
    options = parser.parse_args()
    if unknown := set(options.tools) - {tool.key for tool in TOOLS}:
        parser.error(f"no such tool: {', '.join(sorted(unknown))}")
    if options.render:
        _keep({})
        return
    tools = _installed([tool for tool in TOOLS if not options.tools or tool.key in options.tools])
    cases = [case for case in CASES if not options.log or case.name in options.log]
    quick: dict[str, Any] = {}
    for results in measured(tools, cases, 1 if options.quick else None):
        if options.quick:
            quick = merged(quick, results)
        else:
            _keep(results)  # now, so that an interrupted run keeps its results
    if options.quick:
        Console().print(render(quick), markup=False)
    elif any(tool.key == "flexid_identify" for tool in tools):
        _keep({"command": _command()})


def _keep(results: Mapping[str, Any]) -> None:
    """Merge results into the current file, and rewrite the page."""
    kept = json.loads(RESULTS.read_text(encoding="utf-8")) if RESULTS.exists() else {}
    together = merged(kept, results)
    RESULTS.write_text(_text(together), encoding="utf-8")
    write_block(PAGE, BLOCK, render(together))


def merged(kept: Mapping[str, Any], found: Mapping[str, Any]) -> dict[str, Any]:
    """Return new results, and old ones of tools and kinds of log that are not among the new."""
    tools = dict(kept.get("tools", {}))
    for key, entry in found.get("tools", {}).items():
        fresh = {run["case"] for run in entry["runs"]}
        old = [run for run in tools.get(key, {}).get("runs", []) if run["case"] not in fresh]
        order = [case.name for case in CASES]
        runs = sorted(old + entry["runs"], key=lambda run: (order.index(run["case"]), run["seed"]))
        tools[key] = {**entry, "runs": runs}
    ordered = {tool.key: tools[tool.key] for tool in TOOLS if tool.key in tools}
    return {**kept, **found, "tools": ordered}


def _installed(tools: Sequence[Tool]) -> list[Tool]:
    missing = [tool for tool in tools if importlib.util.find_spec(tool.package) is None]
    for tool in missing:
        print(f"{tool.title} left out: {tool.package} is not installed", file=sys.stderr)
    return [tool for tool in tools if tool not in missing]


def measured(
    tools: Sequence[Tool], cases: Sequence[Case], most: int | None
) -> Iterator[dict[str, Any]]:
    """Run all tools on each log, one kind of log after the other, and return the results.

    Parameters
    ----------
    tools : sequence of Tool
    cases : sequence of Case
    most : int or None
        Largest number of logs of each kind; by default the tool's own number.
    """
    for tool in tools:
        if not tool.slow:
            _run(tool, CASES[-1].make(Path(), 0))  # compilation and imports are not timed
    for case in cases:
        stamp = {
            "date": str(datetime.datetime.now(datetime.UTC).date()),
            "load": round(os.getloadavg()[0], 2),
        }
        runs = _runs(tools, case, most)
        yield {
            "machine": f"{processor()}, {os.cpu_count()} cores, {platform.system()}",
            "python": platform.python_version(),
            "tools": {
                tool.key: {
                    "version": version(tool.package),
                    "lines": lines_of_user_code(tool.source),
                    "runs": [{**stamp, **run} for run in runs[tool.key]],
                }
                for tool in tools
            },
        }


def _runs(tools: Sequence[Tool], case: Case, most: int | None) -> dict[str, list[dict[str, Any]]]:
    runs: dict[str, list[dict[str, Any]]] = {tool.key: [] for tool in tools}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(most or case.only or max(tool.seeds for tool in tools)):
            log = case.make(Path(folder), seed)
            for tool in tools:
                if seed < tool.seeds:
                    print(f"{case.name}, {seed}: {tool.title}", file=sys.stderr)
                    found = {"case": case.name, "seed": seed, **_run(tool, log)}
                    runs[tool.key].append(found)
    return runs


def _run(tool: Tool, log: Log) -> dict[str, Any]:
    """Run a tool once: return errors and widths in percent, or the reason for a failure."""
    identify = importlib.import_module(f"benchmarks.peers.{tool.module}").identify
    try:
        with warnings.catch_warnings(action="ignore"):
            busy = time.process_time()
            answer, seconds = timed(lambda: identify(log, **tool.arguments))
            busy = time.process_time() - busy
    except Exception as reason:  # any failure of a tool is a result
        return {"failed": f"{type(reason).__name__}: {reason}"}
    times = {"seconds": float(f"{seconds:.4g}"), "processor": float(f"{busy:.4g}")}
    return {**times, **_score(answer)}


def _score(answer: Answer) -> dict[str, Any]:
    errors = {name: 100.0 * (answer.values[name] / truth - 1.0) for name, truth in TRUTH.items()}
    if not all(math.isfinite(error) for error in errors.values()):
        return {"failed": "a coefficient is no finite number"}
    score: dict[str, Any] = {"errors": [float(f"{error:.4g}") for error in errors.values()]}
    if answer.intervals is not None:
        ends = {name: answer.intervals[name] for name in TRUTH}
        score["inside"] = [bool(low <= TRUTH[name] <= high) for name, (low, high) in ends.items()]
        widths = (50.0 * (high - low) / TRUTH[name] for name, (low, high) in ends.items())
        score["widest"] = float(f"{max(widths):.4g}")
    return score


def _command() -> dict[str, float]:
    """Return the wall time in s of the command `flexid identify`: before and after compilation."""
    command = [str(Path(sys.executable).with_name("flexid")), "identify", str(EXAMPLE), "--json"]
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"XDG_CACHE_HOME": cache}

        def process() -> object:
            return subprocess.run(command, env=environment, capture_output=True, check=False)

        first = timed(process)[1]
        later = sorted(timed(process)[1] for _ in range(_STARTS))
    return {"first": round(first, 2), "later": round(later[_STARTS // 2], 2)}


def _text(results: Mapping[str, Any]) -> str:
    """Return the results as JSON with a line for each run."""
    text = json.dumps(results, indent=1, ensure_ascii=False)
    return re.sub(r"\{[^{}]*\}", lambda found: " ".join(found[0].split()), text) + "\n"


if __name__ == "__main__":
    main()
