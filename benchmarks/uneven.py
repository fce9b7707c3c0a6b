"""Effect of uneven sampling on the results from realistic logs.

``python -m benchmarks.uneven`` identifies four logs of poor loggers and four of disturbed arms,
with late time stamps as on a busy computer or with missing samples. For inertias and stiffnesses it
prints how many are determined, how many of their intervals contain the truth, and the median
half-width.
"""

from collections.abc import Callable, Mapping
from statistics import median
from typing import TypeAlias

import numpy as np

import flexid
from benchmarks.report import markdown
from benchmarks.size import sized
from benchmarks.trials.realistic.generate import make_realistic
from flexid.arrays import FloatArray

SEEDS = sized(range(20, 24), range(20, 21))
FAMILIES = sized(("poor_logger", "disturbed_arm"), ("poor_logger",))
_TIME = "time [s]"
_LATE, _LATEST = 0.4, 3.0  # sample times: mean and maximum of an exponential delay
_LOST = 0.15  # of the samples

Columns: TypeAlias = Mapping[str, FloatArray]


def _late(columns: Columns, rng: np.random.Generator) -> Columns:
    time = columns[_TIME]
    delays = np.minimum(rng.exponential(_LATE, len(time)), _LATEST)
    return {**columns, _TIME: np.sort(time + (time[1] - time[0]) * delays)}


def _lost(columns: Columns, rng: np.random.Generator) -> Columns:
    count = len(columns[_TIME])
    kept = np.sort(rng.choice(count, round((1.0 - _LOST) * count), replace=False))
    return {name: values[kept] for name, values in columns.items()}


SPOILT: dict[str, Callable[[Columns, np.random.Generator], Columns]] = {
    "as it was logged": lambda columns, _: columns,
    "stamped late": _late,
    "15 % lost": _lost,
}


def main() -> None:
    """Print the table."""
    lines = []
    for name, spoil in SPOILT.items():
        halves, held, count = [], 0, 0
        for family in FAMILIES:
            for seed in SEEDS:
                trial = make_realistic(family, seed)
                columns = spoil(trial.columns, np.random.default_rng(seed))
                found = flexid.identify(columns).parameters
                for core in trial.core:
                    count += 1
                    if core in found and found[core].verdict == "determined":
                        low, high = found[core].interval
                        halves.append(0.5 * (high - low) / abs(trial.truth[core]))
                        held += low <= trial.truth[core] <= high
        half = f"{median(halves):.1%}" if halves else "–"
        lines.append((name, f"{len(halves)} of {count}", f"{held} of {len(halves)}", half))
    print(*markdown(("log", "determined", "contain the truth", "half-width"), lines), sep="\n")


if __name__ == "__main__":
    main()
