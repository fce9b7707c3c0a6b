"""Compare batch least squares on 30 000 samples with NumPy's bare `lstsq`, in one process.

    OPENBLAS_NUM_THREADS=1 python -m benchmarks.batch REPETITIONS

prints the two timings as JSON. It is a separate program because OpenBLAS fixes its number of
threads when NumPy is imported.
"""

import json
import sys
from dataclasses import asdict

import numpy as np
from tests.estimators.noisy_joint import joint_samples

from benchmarks.timing import measure
from flexid.estimators.state_variable_filter import filtered_least_squares, filtered_signals
from flexid.models.flexible_joint import flexible_joint

_SEED = 0
_FILTER_RATE = 20.0  # 1/s


def main(repetitions: int) -> None:
    """Time flexid on the raw record, and `lstsq` on the filtered regressors."""
    record, system = joint_samples(_SEED), flexible_joint()
    signals = filtered_signals([record], system, _FILTER_RATE, "linear")
    ready = [
        (np.ascontiguousarray(signals[part].T), signals[len(system.coefficients) + row].copy())
        for row, (_, part) in enumerate(system.row_slices())
    ]

    def bare() -> None:
        for regressors, left_hand_side in ready:
            np.linalg.lstsq(regressors, left_hand_side, rcond=None)

    timings = measure(
        lambda: filtered_least_squares([record], system, _FILTER_RATE),
        bare,
        lambda: filtered_signals([record], system, _FILTER_RATE, "linear"),
        repetitions=repetitions,
        warm_up=5,
    )
    names = ("filtered_least_squares", "lstsq", "filtered_signals")
    json.dump({n: asdict(t) for n, t in zip(names, timings, strict=True)}, sys.stdout)


if __name__ == "__main__":
    main(int(sys.argv[1]))
