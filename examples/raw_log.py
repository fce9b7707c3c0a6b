"""Turn a log that ``flexid simulate`` made into what a drive's own logger writes.

    flexid simulate experiments/geared_drive.toml --csv --out geared
    python examples/raw_log.py geared/log.csv raw.csv

The motor's encoder counts on its own side of the gear, the torque is the motor's, the link's
encoder gives degrees and is read late. ``examples/columns_geared_drive.toml`` is the column map of
what comes out.
"""

import argparse
from pathlib import Path

import numpy as np

GEAR_RATIO = 101
COUNTS_PER_TURN = 8192  # of the motor
LATE = 2  # samples by which the link's encoder shows the past


def raw(log: np.ndarray) -> dict[str, np.ndarray]:
    """Columns as the logger has them, from time, link, motor and torque in SI units."""
    time, link, motor, torque = log.T
    turns = GEAR_RATIO * motor / (2.0 * np.pi)
    return {
        "t_ms": np.round(1000.0 * time[LATE:], 3),
        "enc_motor": np.round(COUNTS_PER_TURN * turns[LATE:]),
        "enc_link": np.round(np.rad2deg(link[:-LATE]), 6),
        "cmd": np.round(torque[LATE:] / GEAR_RATIO, 6),
    }


def read(path: Path) -> np.ndarray:
    """Time, positions of link and motor, and torque of a log of ``flexid simulate``."""
    with path.open(encoding="utf-8") as file:
        header = file.readline().strip().split(",")
        rows = np.loadtxt(file, delimiter=",")
    names = ("time [s]", "link_position [rad]", "motor_position [rad]", "motor_torque [N m]")
    return rows[:, [header.index(name) for name in names]]


def main() -> None:
    """Convert a log."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path, help="log.csv of a simulated run")
    parser.add_argument("raw", type=Path, help="where to write what the logger would have written")
    arguments = parser.parse_args()
    columns = raw(read(arguments.log))
    lines = [";".join(columns)]
    lines += [
        ";".join(f"{cell:.10g}" for cell in row) for row in zip(*columns.values(), strict=True)
    ]
    arguments.raw.write_text("\n".join(["axis 3, 1 kHz", *lines]) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
