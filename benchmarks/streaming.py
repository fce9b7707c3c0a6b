"""Identification of a long log in one pass, compared with only reading it with Polars.

    python -m benchmarks.streaming [--rows 1e7] [--runs 3]

writes the log into a temporary folder: 23 MB for a million rows.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.comparison import Comparison, Detail, Outcome, Side, duration
from benchmarks.long_log import write_long_log
from benchmarks.report import show
from benchmarks.size import sized
from benchmarks.timing import Timing

_ROWS = 10_000_000
_QUICK_ROWS = sized(1_000_000, 30_000)
_PARTS = {
    "import": "imports",
    "head": "read the head, choose terms, alignment and filter rate on it",
    "pass": "the pass over the log",
    "end": "intervals, verdicts",
}

# Each runs in a separate process, so that the peak memory is its own.
_READ = """
import json, sys, time
import polars as pl
from benchmarks.memory import most_memory
start = time.perf_counter()
for frame in pl.scan_parquet(sys.argv[1]).collect_batches(maintain_order=True):
    pass
json.dump({"read": time.perf_counter() - start,
           "memory": most_memory()}, sys.stdout)
"""
_IDENTIFY = """
import json, sys, time
times = [time.perf_counter()]
from pathlib import Path
from benchmarks.memory import most_memory
from flexid.streaming.whole_log import identify_stream
times.append(time.perf_counter())
def progress(step):
    if step == "streaming" or step.startswith("100 %"):
        times.append(time.perf_counter())
identify_stream(Path(sys.argv[1]), progress=progress)
times.append(time.perf_counter())
parts = {name: b - a for name, a, b in zip(("import", "head", "pass", "end"), times, times[1:])}
json.dump(parts | {"memory": most_memory()}, sys.stdout)
"""


def run(quick: bool) -> Outcome:
    """Stream 10⁷ samples; if quick, fewer samples and repetitions."""
    return measured(_QUICK_ROWS if quick else _ROWS, sized(2, 1) if quick else 5)


def measured(rows: int, runs: int) -> Outcome:
    """Write a log, and stream and read it in turn, a number of times."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "long.parquet"
        write_long_log(path, rows)
        for program in sized((_IDENTIFY, _READ), ()):  # compiles, and fills the disk cache
            _once(program, path)
        rounds = [(_once(_IDENTIFY, path), _once(_READ, path)) for _ in range(runs)]
    own, peer = ({k: [r[side][k] for r in rounds] for k in rounds[0][side]} for side in (0, 1))
    whole = [sum(values) for values in zip(*(own[part] for part in _PARTS), strict=True)]
    name = f"10^{np.log10(rows):.3g} samples"
    reading = Side("Polars reads the file in batches, 2 threads", _timing(peer["read"]))
    comparisons = [
        Comparison(
            f"stream a Parquet log of {name} through least squares",
            Side("one pass, filters of several rates", _timing(own["pass"])),
            reading,
        ),
        Comparison(
            "identify the same log from the start of the process on",
            Side("imports, choices on the head, pass", _timing(whole)),
            reading,
        ),
    ]
    lines = [(words, duration(_timing(own[part]))) for part, words in _PARTS.items()]
    lines += [
        ("samples per second of the pass", f"{rows / float(np.median(own['pass'])):.3g}"),
        ("most memory of the process", f"{max(own['memory']):.0f} MB"),
        ("most memory of the process that only reads", f"{max(peer['memory']):.0f} MB"),
    ]
    return Outcome(comparisons, [Detail(f"Streaming {name}", ("part", "measured"), lines)])


def _once(program: str, path: Path) -> dict[str, float]:
    done = subprocess.run(
        [sys.executable, "-c", program, str(path)], check=True, stdout=subprocess.PIPE
    )
    return json.loads(done.stdout)


def _timing(seconds: Sequence[float]) -> Timing:
    return Timing(float(np.median(seconds)), float(np.min(seconds)), len(seconds))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.streaming")
    parser.add_argument("--rows", type=float, default=_ROWS)
    parser.add_argument("--runs", type=int, default=3)
    arguments = parser.parse_args()
    outcome = measured(int(arguments.rows), arguments.runs)
    show([outcome])
    for line in outcome.details[0].lines:
        print(": ".join(line))
