"""From a log file to uniformly sampled recordings in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.arrays import FloatArray
from flexid.recording import checks
from flexid.recording.channel import ENCODERS, INPUTS, VELOCITIES, Draft
from flexid.recording.columns import read_channels
from flexid.recording.one_clock import drop_holes
from flexid.recording.outliers import mend
from flexid.recording.recording import Log, Recording
from flexid.recording.sampling import (
    Grid,
    drop_repeats,
    even_grid,
    keep_common,
    to_grid,
)
from flexid.recording.series import table_of_file, unwrap
from flexid.recording.slow_motion import check_motion
from flexid.recording.table import Table
from flexid.recording.velocities import is_used

if TYPE_CHECKING:
    from flexid.recording.recipes import MapSource


def read_log(path: Path, columns: MapSource | None = None) -> Log:
    """The log that a file holds, on an even time grid, with what was mended or looks odd."""
    return log_of_table(table_of_file(path, columns), columns)


def log_of_table(table: Table, columns: MapSource | None = None) -> Log:
    """As `read_log`, from a file's columns."""
    return logs_of_joints([(table, columns)])[0]


def logs_of_joints(parts: Sequence[tuple[Table, MapSource | None]]) -> list[Log]:
    """The logs of several joints from their columns in one file, all of the same samples.

    One clock counts them, so that what one joint shows to be lost is lost to all. A joint may rest
    while another one moves.
    """
    drafts = [_drafted(table, columns) for table, columns in parts]
    keep_common(drafts)
    mend(drafts)
    rest = [len(drafts) > 1 and checks.is_resting(draft) for draft in drafts]
    grid = even_grid(drafts)
    return [
        _log_of(draft, table, grid, rests=own and not all(rest))
        for draft, (table, _), own in zip(drafts, parts, rest, strict=True)
    ]


def _drafted(table: Table, columns: MapSource | None) -> Draft:
    """The channels of one joint, without samples that are repeated."""
    channels, warnings = read_channels(table, columns)
    log = Draft(table.file, channels, [*dict.fromkeys(table.warnings + warnings)])
    checks.check_magnitude(log)
    drop_repeats(log, table)
    drop_holes(log)
    checks.drop_frozen(log)
    return log


def _log_of(log: Draft, table: Table, grid: Grid, *, rests: bool) -> Log:
    """Recordings on an even grid, of channels that make sense together."""
    origins = {name: channel.origin for name, channel in log.channels.items()}
    if not rests:
        checks.drop_dead_inputs(log)
        _check_each(log)
    unwrap(log)
    _add_link_position(log)
    if not rests:
        _check_together(log)
    recordings = [
        _recording_of(log, grid.sample_time, part, resample=grid.resample)
        for part in grid.recordings
    ]
    measured = log.those_of(VELOCITIES)
    unused = {name: None for name in measured if not is_used(log, name, recordings)}
    recordings = [replace(recording, **unused) for recording in recordings]
    if not rests:
        check_motion(log, max(recordings, key=len))
    return Log(tuple(recordings), tuple(log.warnings), log.file, table.sha256, origins, rests)


def _check_each(log: Draft) -> None:
    """Check each channel by itself."""
    for name in log.names:
        checks.check_varies(log, name)
        checks.check_saturation(log, name)
        checks.check_repeats(log, name)
        checks.check_whole(log, name)


def _add_link_position(log: Draft) -> None:
    """Compute the link position from the deflection where only that was measured."""
    if "deflection" in log.channels:
        log.channels["link_position"] = log.channels["deflection"]
        log["link_position"] = log["motor_position"] + log["deflection"]


def _check_together(log: Draft) -> None:
    """Check the two sides of the joint and the input against each other."""
    if "deflection" in log.channels:
        checks.check_varies(log, "link_position")
    encoders = log.those_of(ENCODERS)
    for name in encoders:
        checks.check_moves(log, name)
    for name in log.those_of(INPUTS):
        checks.check_copy(log, name)
        checks.check_power(log, name)
    if len(encoders) == 2:
        checks.check_two_encoders(log)
    for name in encoders:
        checks.check_speed(log, name)


def _recording_of(
    log: Draft, sample_time: float, part: slice, *, resample: bool = False
) -> Recording:
    """One recording of a log, interpolated to even times if asked to."""
    time = log.time[part]
    drive = next(iter(log.those_of(INPUTS)), "")

    def sampled(name: str) -> FloatArray | None:
        if name not in log.channels:
            return None
        values = log[name][part]
        return to_grid(time, values, sample_time, held=name == drive) if resample else values

    motor_position = sampled("motor_position")
    assert motor_position is not None
    return Recording(
        sample_time=sample_time,
        start_time=float(time[0]),
        link_position=sampled("link_position"),
        motor_position=motor_position,
        input=sampled(drive),
        input_unit=log.channels[drive].unit if drive else "",
        link_velocity=sampled("link_velocity"),
        motor_velocity=sampled("motor_velocity"),
        source=log.file,
        link_from_deflection="deflection" in log.channels,
        joint=log.joint,
    )
