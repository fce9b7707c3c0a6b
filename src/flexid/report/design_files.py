"""The file of a design: what a drive can play."""

from pathlib import Path

import numpy as np
import polars as pl

from flexid.experiment_design.result import Design

_DIGITS = 10  # significant; a drive has fewer


def save_command(result: Design, directory: Path) -> None:
    """Write command.csv: the torque to play, or the reference with the torque to be expected."""
    table = pl.DataFrame(command_columns(result))
    table.write_csv(directory / "command.csv")


def command_columns(result: Design) -> dict[str, np.ndarray]:
    """What a drive can play, by name with unit."""
    columns = {"time [s]": result.time}
    if result.drive.experiment.kind == "trajectory":
        columns["motor_position_reference [rad]"] = result.command.reference[:, 0]
        columns["motor_velocity_reference [rad/s]"] = result.command.reference[:, 1]
    columns["motor_torque [N m]"] = result.run.torque
    return {name: _rounded(values) for name, values in columns.items()}


def _rounded(values: np.ndarray) -> np.ndarray:
    size = float(np.abs(values).max()) or 1.0
    return np.round(values, max(0, _DIGITS - 1 - int(np.floor(np.log10(size))))) + 0.0
