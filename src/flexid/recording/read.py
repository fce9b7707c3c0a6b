"""From a log file to uniformly sampled recordings in SI units."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from flexid.recording import checks
from flexid.recording.caution import Rank, cautions
from flexid.recording.channel import INPUTS, VELOCITIES, Channel
from flexid.recording.columns import read_channels
from flexid.recording.frozen import without_frozen
from flexid.recording.measured_velocity import check_velocity
from flexid.recording.outliers import mended
from flexid.recording.recording import Log, Recording
from flexid.recording.sampling import check_increasing, even_grid, to_grid
from flexid.recording.series import table_of_file
from flexid.recording.slow_motion import motion_warnings

if TYPE_CHECKING:
    from pathlib import Path

    from flexid.arrays import FloatArray
    from flexid.recording.clock import Clock
    from flexid.recording.column_map import MapSource
    from flexid.recording.table import Table

ENCODERS = ("link_position", "motor_position")


def read_log(path: Path, columns: MapSource | None = None) -> Log:
    """Read a log and check it.

    Parameters
    ----------
    path : Path
        A text file, or one of `flexid.readers.formats`, by the end of its name.
    columns : Path, mapping or None
        A column map: a TOML file, or what it would hold.

    Returns
    -------
    Log
        Its recordings lie on one even time grid; its warnings say what was mended or looks odd.

    Raises
    ------
    RecordingError
        If the log cannot be used; the message names the place and the remedy.
    """
    return log_of_table(table_of_file(path, columns), columns)


def log_of_table(table: Table, columns: MapSource | None = None, clock: Clock | None = None) -> Log:
    """As `read_log`, from a file's columns; of a part of a log with the clock of the whole."""
    channels, warnings = read_channels(table, columns, clock)
    warnings = tuple(dict.fromkeys(table.warnings + warnings))
    origins = {name: channel.origin for name, channel in channels.items()}
    time = channels.pop("time")
    checks.check_magnitude(table.file, "time", time)
    check_increasing(table, time.column, time.values)
    if clock is None:  # what a part ends with may go on in the next one
        channels, time, frozen = without_frozen(table.file, channels, time)
        channels, odd = mended(table.file, channels, time.values)
        warnings += frozen + odd
    grid = even_grid(table, time.column, time.values)
    warnings += grid.warnings
    warnings += _check_each(table.file, channels)
    warnings += _unwrap(table.file, channels, time.values)
    _add_link_position(table.file, channels)
    warnings += cautions(Rank.SCALE, _check_together(table.file, channels, time.values))
    recordings = [
        recording_of(
            table.file, channels, time.values, grid.sample_time, part, resample=grid.resample
        )
        for part in grid.recordings
    ]
    unused, found = _check_velocities(table.file, channels, recordings)
    recordings = [replace(recording, **unused) for recording in recordings]
    warnings += found
    names = [channels[name].column for name in ENCODERS if name in channels]
    place = f"{table.file}: columns {' and '.join(map(repr, names))}"
    warnings += tuple(motion_warnings(max(recordings, key=len), place))
    return Log(tuple(recordings), warnings, table.file, table.sha256, origins)


def _check_each(file: str, channels: dict[str, Channel]) -> tuple[str, ...]:
    """Check every channel by itself."""
    warnings: tuple[str, ...] = ()
    for name, channel in channels.items():
        checks.check_magnitude(file, name, channel)
        checks.check_varies(file, name, channel)
        warnings += cautions(Rank.DATA, checks.check_saturation(file, name, channel))
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
    warnings = []
    unwrapped = []
    for name in ENCODERS:
        if name in channels:
            values, warning = checks.unwrap(file, name, channels[name], time)
            if warning:
                channels[name] = replace(channels[name], values=values)
                warnings.append(warning)
                unwrapped.append(name)
            warnings += cautions(Rank.DATA, checks.check_jumps(file, name, channels[name], time))
    if unwrapped and all(name in channels for name in ENCODERS):
        name = unwrapped[-1]
        (other,) = (channels[one].values for one in ENCODERS if one != name)
        values = channels[name].values
        turns = checks.turns_apart(values, other)
        channels[name] = replace(channels[name], values=values + turns)
    return tuple(warnings)


def _add_link_position(file: str, channels: dict[str, Channel]) -> None:
    """Compute the link position from the deflection where only that was measured."""
    if "deflection" in channels:
        motor, deflection = channels["motor_position"], channels["deflection"]
        link = replace(deflection, values=motor.values + deflection.values)
        checks.check_varies(file, "link_position", link)
        channels["link_position"] = link


def _check_together(file: str, channels: dict[str, Channel], time: FloatArray) -> tuple[str, ...]:
    """Check the speed of each side of the joint, and the two against each other."""
    motor = channels["motor_position"]
    for name in ENCODERS:
        if name in channels:
            checks.check_moves(file, name, channels[name])
    for name in INPUTS:
        if name in channels:
            checks.check_copy(file, name, channels, time)
    if "link_position" not in channels:
        return checks.check_speed(file, "motor_position", motor, time)
    link = channels["link_position"]
    checks.check_two_encoders(file, link, motor)
    warnings = checks.check_follow(file, link, motor)
    for name in ENCODERS:
        warnings += checks.check_speed(file, name, channels[name], time)
    return warnings


def recording_of(
    file: str,
    channels: dict[str, Channel],
    time: FloatArray,
    sample_time: float,
    part: slice,
    *,
    resample: bool = False,
) -> Recording:
    """Build one recording of a log.

    Parameters
    ----------
    file : str
        Its name.
    channels : dict of str to Channel
        By canonical name.
    time : FloatArray, shape (n,)
        In s.
    sample_time : float
        In s.
    part : slice
        Samples of the recording.
    resample : bool, optional
        Whether to interpolate to even times.
    """
    drive_name = next((name for name in INPUTS if name in channels), None)

    def sampled(name: str) -> FloatArray:
        values = channels[name].values[part]
        if not resample:
            return values
        return to_grid(time[part], values, sample_time, held=name == drive_name)

    return Recording(
        sample_time=sample_time,
        start_time=float(time[part.start]),
        link_position=sampled("link_position") if "link_position" in channels else None,
        motor_position=sampled("motor_position"),
        input=None if drive_name is None else sampled(drive_name),
        input_unit="" if drive_name is None else channels[drive_name].unit,
        link_velocity=sampled("link_velocity") if "link_velocity" in channels else None,
        motor_velocity=sampled("motor_velocity") if "motor_velocity" in channels else None,
        source=file,
        link_from_deflection="deflection" in channels,
    )
