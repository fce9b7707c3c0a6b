"""Time of the prediction error over the record's length, with one and two threads.

python -m benchmarks.prediction_error_growth [--samples 3e4 1e5 3e5 1e6]
"""

import argparse
import json
import subprocess
import sys

from benchmarks.comparison import AtLeast, AtMost, Comparison, Detail, Outcome, Side, duration
from benchmarks.report import show
from benchmarks.size import sized
from benchmarks.timing import Timing

_SAMPLES = (30_000, 100_000, 300_000, 1_000_000)
_QUICK_SAMPLES = sized((30_000, 100_000), (2_000, 4_000))
_RUNS = 3

# Each length has its own process, so that the peak memory is its own.
_PROGRAM = """
import json, sys
import numpy as np
from benchmarks.memory import most_memory
from benchmarks.long_log import POSITION_NOISE, SAMPLE_TIME, SEED, TRUTH, long_motion
from benchmarks.timing import measure
from flexid.estimators import samples
from flexid.estimators.prediction_error import prediction_error
from flexid.estimators.samples import Samples
from flexid.estimators.state_variable_filter import filtered_least_squares
from flexid.models.flexible_joint import flexible_joint
joint, count, runs = flexible_joint(), int(sys.argv[1]), int(sys.argv[2])
positions, torque, _ = long_motion(0, count, np.zeros(4))
record = Samples(positions, None, torque[:, None], SAMPLE_TIME)
start = filtered_least_squares([record], joint)
def fit(cores):
    samples.cores = lambda: cores
    return prediction_error([record], joint, start)
one, two = measure(lambda: fit(1), lambda: fit(2), repetitions=runs)
same = fit(1).values.tobytes() == fit(2).values.tobytes()
json.dump({"one": [one.median, one.minimum], "two": [two.median, two.minimum], "same": same,
           "memory": most_memory()}, sys.stdout)
"""


def run(quick: bool) -> Outcome:
    """Fit records of several lengths with one thread and with two."""
    return measured(_QUICK_SAMPLES if quick else _SAMPLES, _RUNS)


def measured(samples: tuple[int, ...], runs: int) -> Outcome:
    """Fit records of the given lengths repeatedly."""
    results = {count: _once(count, runs) for count in samples}
    one = {n: _timing(r["one"], runs) for n, r in results.items()}
    two = {n: _timing(r["two"], runs) for n, r in results.items()}
    shortest, longest = min(samples), max(samples)
    comparisons = [
        Comparison(
            f"prediction error, {longest:,} samples".replace(",", " "),
            Side("2 threads", two[longest]),
            Side("flexid, 1 thread", one[longest]),
            AtLeast(1.5),
        ),
        Comparison(
            "prediction error, a sample of the longest record against one of the shortest",
            Side(f"{longest:,} samples, 2 threads".replace(",", " "), two[longest].per(longest)),
            Side(f"flexid, {shortest:,} samples".replace(",", " "), two[shortest].per(shortest)),
            AtMost(1.5),
        ),
    ]
    lines = [
        (
            f"{n:,}".replace(",", " "),
            duration(one[n]),
            duration(two[n]),
            f"{1e6 * two[n].median / n:.2f} µs",
            "yes" if results[n]["same"] else "NO",
            f"{results[n]['memory']:.0f} MB",
        )
        for n in samples
    ]
    headings = ("samples", "1 thread", "2 threads", "per sample", "same bits", "most memory")
    return Outcome(
        comparisons, [Detail("Prediction error and the length of the record", headings, lines)]
    )


def _timing(seconds: list[float], runs: int) -> Timing:
    median, minimum = seconds
    return Timing(median, minimum, runs)


def _once(count: int, runs: int) -> dict:
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, str(count), str(runs)], check=True, stdout=subprocess.PIPE
    )
    return json.loads(done.stdout)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m benchmarks.prediction_error_growth")
    parser.add_argument("--samples", type=float, nargs="+", default=_SAMPLES)
    outcome = measured(tuple(int(n) for n in parser.parse_args().samples), _RUNS)
    show([outcome])
    for line in outcome.details[0].lines:
        print(" | ".join(line))
