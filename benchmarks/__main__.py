"""Run the benchmarks of speed: ``python -m benchmarks [NAME ...] [--quick]`` in a clone.

--quick runs the slowest peers with one tolerance and repeats less. With --quick, or with benchmarks
chosen by name, `RESULTS.md` does not change.
"""

import argparse
import importlib
import os

from benchmarks.report import show, write

NAMES = (
    "identify",
    "prediction_error_growth",
    "streaming",
    "observer",
    "closed_loop",
    "sampled_loop",
    "ensemble",
    "campaign",
)
"""Modules with a function `run`, in the order of the results."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("--quick", action="store_true")
    options = parser.parse_args()
    if unknown := set(options.names) - set(NAMES):
        parser.error(f"no such benchmark: {', '.join(sorted(unknown))}")
    busy = os.getloadavg()[0]
    parts = [importlib.import_module(f"benchmarks.{name}") for name in options.names or NAMES]
    outcomes = [part.run(options.quick) for part in parts]
    show(outcomes)
    if not options.quick and not options.names:
        write(outcomes, "python -m benchmarks", busy)


if __name__ == "__main__":
    main()
