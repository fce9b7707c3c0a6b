"""Logs from files, data frames, mappings of arrays, recordings, or lists of these."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from flexid.errors import SettingError
from flexid.library.arguments import entrance
from flexid.recording.recording import CHANNELS, Log, Recording

if TYPE_CHECKING:
    from narwhals.typing import IntoDataFrame
    from numpy.typing import ArrayLike

    from flexid.estimators.samples import Samples
    from flexid.recording.recipes import MapSource

    OneLog: TypeAlias = (
        str | os.PathLike[str] | IntoDataFrame | Mapping[str, ArrayLike] | Log | Recording
    )
    """A file, a data frame, arrays by name, or the result of `read_log`."""

    Logs: TypeAlias = OneLog | Sequence[OneLog]
    """One log, or several of the same drive."""

    Columns: TypeAlias = str | os.PathLike[str] | Mapping[str, object]
    """A column map: a TOML file, or its content as a mapping."""


@entrance
def read_log(log: OneLog, *, columns: Columns | None = None) -> Log:
    """Read and check a log, as all functions that take logs do.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log or Recording
        A text file, or one in any format that flexid reads; a data frame of pandas, Polars,
        PyArrow or another library that narwhals knows; arrays by name. Columns are found by name,
        with their unit in brackets: ``"time [s]"``, ``"link_position [deg]"``,
        ``"motor_position [deg]"``, ``"motor_torque [N m]"``; without a unit they are in SI.
    columns : path or mapping, optional
        A column map for raw sensor columns: a TOML file, or its content as a mapping,
        ``{"motor_position": {"column": "pot_V", "scale": 35.32, "unit": "deg"}}``.

    Returns
    -------
    Log
        Recordings in SI units on an even time grid, one for each gap-free part. Its ``warnings``
        name what was repaired or looks unusual.
    """
    from flexid.recording.read import log_of_table
    from flexid.recording.read import read_log as read

    if isinstance(log, Log | Recording):
        if columns is not None:
            raise SettingError("columns", "is for unread logs, and this one is read: leave it out")
        return log if isinstance(log, Log) else _log_of(log)
    column_map = as_columns(columns)
    if isinstance(log, str | os.PathLike):
        return read(Path(log), column_map)
    from flexid.recording.frame import table_of_arrays, table_of_frame

    table = table_of_arrays(log) if isinstance(log, Mapping) else table_of_frame(log)
    return log_of_table(table, column_map)


@entrance
def samples(log: OneLog, *, columns: Columns | None = None) -> tuple[Samples, ...]:
    """Return the samples of a log for estimators, one `Samples` for each recording.

    Parameters
    ----------
    log : path, data frame, mapping of arrays, Log or Recording
        As `read_log` takes it. A log of one encoder gives samples of a rigid joint.
    columns : path or mapping, optional
        A column map for raw sensor columns. As `read_log` takes it.

    Returns
    -------
    tuple of Samples
        Positions, velocities where they were measured, and inputs, with the sample time.
    """
    from flexid.estimators.samples import samples_of_recording

    return tuple(
        samples_of_recording(part, "rigid" if part.link_position is None else "flexible")
        for part in read_log(log, columns=columns).recordings
    )


def all_logs(logs: Any, columns: Any) -> list[Log]:
    """Read each log of a list."""
    return [read_log(log, columns=columns) for log in logs]


def as_columns(columns: Columns | None) -> MapSource | None:
    """Return a column map as a path or a mapping."""
    return columns if columns is None or isinstance(columns, Mapping) else Path(columns)


def _log_of(recording: Recording) -> Log:
    """Return a log that consists of one recording."""
    digest = hashlib.sha256(f"{recording.sample_time} {recording.start_time}".encode())
    for channel in CHANNELS:
        values = getattr(recording, channel)
        if values is not None:
            digest.update(np.ascontiguousarray(values).tobytes())
    return Log((recording,), (), recording.source or "recording", digest.hexdigest())
