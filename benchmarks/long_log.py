"""Write a long log of the paper's joint part by part, with one part in memory.

    python -m benchmarks.long_log FILE ROWS

writes the Parquet file. The torque is a sum of sines that never repeats, and the positions have
white noise. All values depend only on the seed and the number of the part.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import polars as pl
from numpy.typing import NDArray

from flexid.models.flexible_joint import flexible_joint
from flexid.simulation.free_run import free_run

SAMPLE_TIME = 1e-3  # s
POSITION_NOISE = 1e-4  # rad
SEED = 0

TRUTH = {"theta1": 5.0, "theta2": 100.0, "alpha1": 1000 / 3, "alpha2": 1 / 3, "beta1": 10 / 3}
"""Coefficients of Huang (2003), Table I."""

_PART = 1_000_000  # rows in memory
_RATES = np.array([1.0, 4.3166, 7.4162, 11.3, 17.9])  # rad/s, without a common period
_SIZES = np.array([1.5, 3.0, 4.0, 5.0, 6.0])  # N m, too small for a full turn of the link


def long_motion(
    number: int, count: int, state: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return noisy positions and torque of a part, and the initial state of the next one."""
    # The last of these samples is the first of the next part.
    torque = np.sin(np.outer(_times(number, count + 1), _RATES)) @ _SIZES
    states = free_run(flexible_joint(), TRUTH, state, torque, SAMPLE_TIME, "linear")
    generator = np.random.default_rng((SEED, number))
    noisy = states[:-1, ::2] + POSITION_NOISE * generator.standard_normal((count, 2))
    return noisy, torque[:-1], states[-1].copy()


def _times(number: int, count: int) -> NDArray[np.float64]:
    return SAMPLE_TIME * np.arange(number * _PART, number * _PART + count, dtype=np.float64)


def write_long_log(path: Path, rows: int) -> None:
    """Write a log with a number of rows."""
    state = np.zeros(4)
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        names = []
        for number, first in enumerate(range(0, rows, _PART)):
            count = min(_PART, rows - first)
            positions, torque, state = long_motion(number, count, state)
            names.append(Path(folder) / f"{number:05d}.parquet")
            pl.DataFrame(
                {
                    "time [s]": _times(number, count),
                    "link_position [rad]": positions[:, 0],
                    "motor_position [rad]": positions[:, 1],
                    "motor_torque [N m]": torque,
                }
            ).write_parquet(names[-1])
        pl.scan_parquet(names).sink_parquet(path)


if __name__ == "__main__":
    write_long_log(Path(sys.argv[1]), int(float(sys.argv[2])))
