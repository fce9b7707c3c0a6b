"""A small synthetic log, and ways to write it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from flexid.arrays import FloatArray

Columns = Mapping[str, FloatArray]


def joint_columns(count: int = 400, sample_time: float = 0.005) -> dict[str, FloatArray]:
    """Return canonical columns of a smooth, plausible motion, in SI units."""
    time = sample_time * np.arange(count, dtype=np.float64)
    motor = np.sin(2.0 * time) + 0.4 * np.sin(5.3 * time + 0.5)
    motor_velocity = 2.0 * np.cos(2.0 * time) + 2.12 * np.cos(5.3 * time + 0.5)
    deflection = 0.05 * np.sin(3.7 * time + 1.0)
    return {
        "time": time,
        "link_position": motor + deflection,
        "motor_position": motor,
        "link_velocity": motor_velocity + 0.185 * np.cos(3.7 * time + 1.0),
        "motor_velocity": motor_velocity,
        "motor_torque": 20.0 * np.sin(2.0 * time) + 10.0 * np.sin(5.3 * time),
    }


def csv_text(columns: Columns) -> str:
    """Return columns as CSV text with all digits."""
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    lines = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
    return "\n".join(lines) + "\n"


def write_csv(folder: Path, columns: Columns, name: str = "log.csv") -> Path:
    """Write columns to a CSV file and return its path."""
    path = folder / name
    path.write_text(csv_text(columns), encoding="utf-8")
    return path
