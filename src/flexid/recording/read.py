"""From a log file to uniformly sampled pieces in SI units."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.columns import INPUTS, read_channels
from flexid.recording.recording import Log, Recording
from flexid.recording.table import read_table

if TYPE_CHECKING:
    from pathlib import Path


def read_log(path: Path, columns: Path | None = None) -> Log:
    """Read a log.

    Parameters
    ----------
    path : Path
        A CSV file, or a Parquet file if its name ends in ``.parquet`` or ``.pq``.
    columns : Path or None
        A TOML column map.

    Returns
    -------
    Log

    Raises
    ------
    RecordingError
        If the log cannot be used; the message names the place and the remedy.
    """
    table = read_table(path)
    channels, warnings = read_channels(table, columns)
    time = channels["time"].values
    if len(time) < 20 or not np.all(np.diff(time) > 0):
        raise RecordingError(table.file, "", "time does not increase: sort the rows")
    motor = channels["motor_position"].values
    link = (
        channels["link_position"].values
        if "link_position" in channels
        else motor + channels["deflection"].values
    )
    drive = next(channels[name] for name in INPUTS if name in channels)
    measured = {
        name: channels[name].values if name in channels else None
        for name in ("link_velocity", "motor_velocity")
    }
    piece = Recording(
        sample_time=float((time[-1] - time[0]) / (len(time) - 1)),
        start_time=float(time[0]),
        link_position=link,
        motor_position=motor,
        input=drive.values,
        input_unit=drive.unit,
        source=table.file,
        **measured,
    )
    return Log((piece,), warnings, table.file, table.sha256)
