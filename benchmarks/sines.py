"""Correct and wrong results from steady motion on one sine, by the least unexplained share.

    PYTHONPATH=tests python -m benchmarks.sines [JOBS]

Each log is identified without the rule on poor excitation (`lost_share`).
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import pairwise, product
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

import joint_logs
from benchmarks.size import sized
from flexid.identification.estimation import excitations, final_fits
from flexid.identification.identify import identify
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.recording.read import read_log

AMPLITUDES = sized((0.05, 0.1, 0.3, 1.0, 1.5), (1.0,))  # rad
RATES = sized((1.0, 2.0, 5.0, 8.0), (2.0,))  # rad/s
NOISES = sized((1e-4, 1e-6), (1e-4,))  # rad
MOTORS = sized((0.3, 0.005), (0.3,))  # kg m2
EDGES = (-1.0, 0.001, 0.002, 0.004, 0.008, np.inf)
CORE = {"gravity_torque": 5.0, "link_inertia": 0.5, "joint_stiffness": 100.0}
WRONG = 0.01  # least relative error of a wrong value, which also is outside its interval

Log = tuple[float, float, float, float]


def of_log(task: Log) -> tuple[float, int, bool]:
    """Return the least share of a log's rows, its determined core values, and whether one errs."""
    amplitude, rate, noise, motor = task
    truth = {**CORE, "motor_inertia": motor}
    values = (10.0, 200.0, 100.0 / motor, 0.1 / motor, 1.0 / motor)
    shares = [np.inf]

    def watched(rows: Any, found: Any, lost_share: float) -> Any:
        rows = [row for row in rows if row.coefficients]
        shares.append(min(excitations.directions(row, found)[0][0] for row in rows))
        return excitations.unexcited(rows, found, lost_share)

    with (
        tempfile.TemporaryDirectory() as folder,
        warnings.catch_warnings(action="ignore"),
        patch.object(joint_logs, "TRUE", dict(zip(joint_logs.TRUE, values, strict=True))),
        patch.object(joint_logs, "NOISE", noise),
        patch.object(final_fits, "unexcited", watched),
    ):
        motion = joint_logs.steady_sine(amplitude, rate, sized(20.0, 8.0), joint_logs.FINE)
        path = joint_logs.write_log(Path(folder) / "log.csv", *motion)
        found = identify([read_log(path)], thresholds=replace(THRESHOLDS, lost_share=0.0))
    core = {n: p for n, p in found.parameters.items() if n in truth and p.verdict == "determined"}
    off = {n: abs(p.value / truth[n] - 1.0) for n, p in core.items()}
    wrong = any(
        off[n] > WRONG and not p.interval[0] <= truth[n] <= p.interval[1] for n, p in core.items()
    )
    return min(shares), len(core), wrong


def main() -> None:
    """Print a line for each range of the share."""
    tasks = list(product(AMPLITUDES, RATES, NOISES, MOTORS))
    jobs = int(sys.argv[1]) if len(sys.argv) > 1 else None
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        logs = [log for log in pool.map(of_log, tasks) if np.isfinite(log[0])]
    for low, high in pairwise(EDGES):
        here = [log for log in logs if low <= log[0] < high]
        wrong = sum(log[2] for log in here)
        right = sum(log[1] == 1 + len(CORE) and not log[2] for log in here)
        print(f"below {high:g}: {len(here)} logs, {wrong} wrong, {right} with all four right")


if __name__ == "__main__":
    main()
