"""Run all benchmarks from the root of a clone: ``python -m benchmarks [--quick]``.

--quick leaves the slowest peers at one tolerance, repeats less and leaves `RESULTS.md` alone.
"""

import argparse
import os

from benchmarks import (
    campaign,
    closed_loop,
    ensemble,
    identify,
    observer,
    prediction_error_growth,
    sampled_loop,
    streaming,
)
from benchmarks.report import show, write


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--quick", action="store_true")
    quick: bool = parser.parse_args().quick
    busy = os.getloadavg()[0]
    parts = (identify, prediction_error_growth, streaming, observer)
    parts += (closed_loop, sampled_loop, ensemble, campaign)
    outcomes = [part.run(quick) for part in parts]
    show(outcomes)
    if not quick:
        write(outcomes, "python -m benchmarks", busy)


if __name__ == "__main__":
    main()
