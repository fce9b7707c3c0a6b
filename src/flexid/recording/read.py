"""From a log file to uniformly sampled recordings in SI units."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flexid.recording import checks, wraps
from flexid.recording.caution import Rank, cautions
from flexid.recording.channel import INPUTS, VELOCITIES, Channel
from flexid.recording.columns import read_channels
from flexid.recording.frozen import without_frozen
from flexid.recording.measured_velocity import check_velocity
from flexid.recording.one_clock import without_holes
from flexid.recording.outliers import mended
from flexid.recording.recording import Log, Recording
from flexid.recording.sampling import even_grid, to_grid, without_repeats
from flexid.recording.series import table_of_file
from flexid.recording.slow_motion import motion_warnings

if TYPE_CHECKING:
    from pathlib import Path

    from flexid.arrays import FloatArray
    from flexid.recording.column_map import MapSource
    from flexid.recording.table import Table

ENCODERS = ("link_position", "motor_position")


def read_log(path: Path, columns: MapSource | None = None) -> Log:
    """The log that a file holds, on an even time grid, with what was mended or looks odd."""
    return log_of_table(table_of_file(path, columns), columns)


def log_of_table(table: Table, columns: MapSource | None = None) -> Log:
    """As `read_log`, from a file's columns."""
    channels, warnings = read_channels(table, columns)
    warnings = tuple(dict.fromkeys(table.warnings + warnings))
    origins = {name: channel.origin for name, channel in channels.items()}
    for name, channel in channels.items():
        checks.check_magnitude(table.file, name, channel)
    time, again = wraps.count_on(table.file, channels.pop("time"))
    channels, time, repeated = without_repeats(table, channels, time)
    channels, time, holes = without_holes(table.file, channels, time)
    channels, time, frozen = without_frozen(table.file, channels, time)
    channels, values, uncounted, odd = mended(table.file, channels, time.values)
    time = replace(time, values=values)
    warnings += again + repeated + holes + frozen + odd
    grid = even_grid(table, time.column, time.values)
    warnings += grid.warnings
    warnings += _check_each(table.file, channels)
    warnings += _unwrap(table.file, channels, time.values)
    add_link_position(channels)
    if "deflection" in channels:
        checks.check_varies(table.file, "link_position", channels["link_position"])
    warnings += cautions(Rank.SCALE, _check_together(table.file, channels, time.values))
    recordings = [
        recording_of(
            table.file, channels, time.values, grid.sample_time, part, resample=grid.resample
        )
        for part in grid.recordings
    ]
    unused, found = _check_velocities(table.file, channels, recordings)
    recordings = [replace(recording, **unused) for recording in recordings]
    names = [channels[name].column for name in ENCODERS if name in channels]
    place = f"{table.file}: columns {' and '.join(map(repr, names))}"
    warnings += (*found, *motion_warnings(max(recordings, key=len), place))
    return Log(tuple(recordings), warnings, table.file, table.sha256, origins, uncounted)


def _check_each(file: str, channels: dict[str, Channel]) -> tuple[str, ...]:
    """Check every channel by itself."""
    warnings: tuple[str, ...] = ()
    for name, channel in channels.items():
        checks.check_varies(file, name, channel)
        warnings += cautions(Rank.DATA, checks.check_saturation(file, name, channel))
        warnings += cautions(Rank.DATA, checks.check_repeats(file, name, channel))
        warnings += cautions(Rank.SCALE, checks.check_whole(file, name, channel))
    return warnings


def _check_velocities(
    file: str, channels: dict[str, Channel], recordings: list[Recording]
) -> tuple[dict[str, None], tuple[str, ...]]:
    """The measured velocities that are not used, as what takes their place, and why."""
    found = {
        name: warning
        for name in VELOCITIES
        if name in channels
        and (warning := check_velocity(file, name, channels[name], recordings)) is not None
    }
    return dict.fromkeys(found), tuple(found.values())


def _unwrap(file: str, channels: dict[str, Channel], time: FloatArray) -> tuple[str, ...]:
    """Replace the positions of absolute encoders by continuous ones, a turn apart at most."""
    warnings: tuple[str, ...] = ()
    wrapped = ""
    for name in ENCODERS:
        if name in channels:
            channels[name], warning = wraps.unwrap(file, name, channels[name], time)
            if warning:
                wrapped = name
                warnings += (warning,)
            warnings += cautions(Rank.DATA, wraps.check_jumps(file, name, channels[name], time))
    if wrapped and all(name in channels for name in ENCODERS):
        (other,) = (channels[one].values for one in ENCODERS if one != wrapped)
        values = channels[wrapped].values
        turns = wraps.turns_apart(values, other)
        channels[wrapped] = replace(channels[wrapped], values=values + turns)
    return warnings


def add_link_position(channels: dict[str, Channel]) -> None:
    """Compute the link position from the deflection where only that was measured."""
    if "deflection" in channels:
        motor, deflection = channels["motor_position"], channels["deflection"]
        channels["link_position"] = replace(deflection, values=motor.values + deflection.values)


def _check_together(file: str, channels: dict[str, Channel], time: FloatArray) -> tuple[str, ...]:
    """Check the two sides of the joint and the input against each other."""
    encoders = {name: channels[name] for name in ENCODERS if name in channels}
    for name, channel in encoders.items():
        checks.check_moves(file, name, channel)
    warnings: tuple[str, ...] = ()
    for name in INPUTS:
        if name in channels:
            checks.check_copy(file, name, channels, time)
            warnings += checks.check_power(file, name, channels, time)
    if len(encoders) == 2:
        warnings += checks.check_two_encoders(file, *encoders.values())
    for name, channel in encoders.items():
        warnings += checks.check_speed(file, name, channel, time)
    return warnings


def recording_of(
    file: str,
    channels: dict[str, Channel],
    time: FloatArray,  # of all samples, in s
    sample_time: float,
    part: slice,
    *,
    resample: bool = False,
) -> Recording:
    """One recording of a log, interpolated to even times if asked to."""
    drive = next((name for name in INPUTS if name in channels), "")

    def sampled(name: str) -> FloatArray | None:
        if name not in channels:
            return None
        values = channels[name].values[part]
        return to_grid(time[part], values, sample_time, held=name == drive) if resample else values

    motor_position = sampled("motor_position")
    assert motor_position is not None
    return Recording(
        sample_time=sample_time,
        start_time=float(time[part.start]),
        link_position=sampled("link_position"),
        motor_position=motor_position,
        input=sampled(drive),
        input_unit=channels[drive].unit if drive else "",
        link_velocity=sampled("link_velocity"),
        motor_velocity=sampled("motor_velocity"),
        source=file,
        link_from_deflection="deflection" in channels,
    )
