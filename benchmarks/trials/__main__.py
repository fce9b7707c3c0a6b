"""Blind trials: logs of random drives, identified without the truth and scored against it.

    python -m benchmarks.trials [--seeds N] [--first-seed K] [--family F ...] [--realistic]
                                [--with-structure] [--jobs J] [--out FILE]
    python -m benchmarks.trials --merge FILE ... [--out FILE] [--page docs/trials.md]

in the root of a clone. Seeds below 1000 are for development; those from 1000 on are for reports.
"""

import argparse
import os
import sys
from pathlib import Path

from benchmarks.page_block import write_block
from benchmarks.trials import run
from benchmarks.trials.families import FAMILIES
from benchmarks.trials.options import add_log_options, logs_of
from benchmarks.trials.page import BLOCK, render, terminal
from benchmarks.trials.realistic.families import REALISTIC


def main() -> None:
    """Run trials or merge results, and print the scores."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.trials",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add_log_options(parser, 10, [*FAMILIES, *REALISTIC])
    parser.add_argument(
        "--realistic",
        action="store_true",
        help="the realistic families, where no family is named; no log has --with-structure there",
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes")
    parser.add_argument(
        "--with-structure",
        action="store_true",
        help="identify each log once more with terms, hold and delays given, and by least squares",
    )
    parser.add_argument("--out", type=Path, help="file for the results")
    parser.add_argument("--merge", type=Path, nargs="+", help="files of results; nothing is run")
    parser.add_argument("--page", type=Path, help="page whose tables are made again")
    options = parser.parse_args()
    if options.merge:
        results = run.merged([run.read(path) for path in options.merge])
        if options.out:
            options.out.write_text(run.text(results), encoding="utf-8")
    else:
        families = REALISTIC if options.realistic else FAMILIES
        tasks = [(*log, options.with_structure) for log in logs_of(options, families)]
        command = " ".join(["python -m benchmarks.trials", *sys.argv[1:]])
        results = run.run(tasks, options.jobs, command, options.out)
    print(terminal(results))
    if options.page:
        write_block(options.page, BLOCK, render(results))


if __name__ == "__main__":
    main()
