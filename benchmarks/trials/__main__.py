"""Blind trials: logs of random drives, identified blindly and scored against the truth.

    python -m benchmarks.trials [--seeds N] [--first-seed K] [--family F ...] [--with-structure]
                                [--jobs J] [--out FILE]
    python -m benchmarks.trials --merge FILE ... [--out FILE] [--page docs/trials.md]

in the root of a clone. Seeds below 1000 are for development; those from 1000 on are for reports.
"""

import argparse
import os
import sys
from pathlib import Path

from benchmarks.page_block import with_block
from benchmarks.trials import run
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.page import BLOCK, render, terminal


def main() -> None:
    """Run or merge, and show what came out."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.trials",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seeds", type=int, default=10, help="logs of each family")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--family", action="append", choices=list(FAMILIES), help="may be repeated")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument(
        "--with-structure",
        action="store_true",
        help="identify each log once more with terms, hold and delays given, and by least squares",
    )
    parser.add_argument("--out", type=Path, help="file for the results")
    parser.add_argument("--merge", type=Path, nargs="+", help="files of results; nothing is run")
    parser.add_argument("--page", type=Path, help="page whose tables are made anew")
    options = parser.parse_args()
    if options.merge:
        results = run.merged([run.read(path) for path in options.merge])
        if options.out:
            options.out.write_text(run.text(results), encoding="utf-8")
    else:
        seeds = range(options.first_seed, options.first_seed + options.seeds)
        # All families early: what is broken off tells something of each.
        families = options.family or FAMILIES
        tasks = [(name, seed, options.with_structure) for seed in seeds for name in families]
        command = " ".join(["python -m benchmarks.trials", *sys.argv[1:]])
        results = run.run(tasks, options.jobs, command, options.out)
    print(terminal(results))
    if options.page:
        page = options.page.read_text(encoding="utf-8")
        options.page.write_text(with_block(page, BLOCK, render(results)), encoding="utf-8")


if __name__ == "__main__":
    main()
