"""Reading of log files as uniformly sampled recordings in SI units."""

from __future__ import annotations

import re
from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.readers.formats import format_of
from flexid.recording import checks
from flexid.recording.columns import read_channels
from flexid.recording.jumps import align, count_positions_over, find_seams, unwrap
from flexid.recording.outliers import mend
from flexid.recording.recipes import MapSource
from flexid.recording.recording import ENCODERS, INPUTS, VELOCITIES, Draft, Log, Rank, Recording
from flexid.recording.sampling import (
    EVEN,
    MOST_GAPS,
    Grid,
    are_gaps,
    count_on,
    count_time_over,
    drop_repeats,
    even_grid,
    interpolated,
    keep_common,
)
from flexid.recording.slow_motion import are_opposed, check_motion, correct_signs
from flexid.recording.table import Table
from flexid.recording.text import read_table
from flexid.recording.velocities import encoder_step, integral, is_used

# Numbers that programs write where a value is missing: nines, and limits of integers.
_NINES = re.compile(r"-?99\.?9[.9]*")
# Zeros of readings that failed: at least three in a log, at most three in a row, and ten times as
# far from the values around them as these are apart. A smaller one does little harm.
_FEWEST_ZEROS, _LONGEST_ZERO, _APART = 3, 3, 10.0
_LIMITS = np.array([2**15 - 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1], dtype=np.float64)


def read_log(path: Path, columns: MapSource | None = None) -> Log:
    """Return the log in a file, on an even time grid, with warnings of repairs and oddities."""
    return log_of_table(table_of_file(path, columns), columns)


def table_of_file(path: Path, columns: MapSource | None) -> Table:
    """Return the columns of a file of any format that a column map or their names select."""
    with closing(tables_of_file(path, columns, None)) as tables:
        return next(tables)


def tables_of_file(path: Path, columns: MapSource | None, size: int | None) -> Generator[Table]:
    """Yield the selected columns in tables of about `size` rows; raise where a file is damaged."""
    if format_of(path) is None:
        yield read_table(path)
        return
    # Imported here, because text files need neither a child process nor resampling.
    from flexid.readers.guard import Reading
    from flexid.recording.series import Signals

    with Reading(path) as reading:
        yield from Signals(reading, columns).tables(size)


def log_of_table(table: Table, columns: MapSource | None = None, *, is_stream: bool = False) -> Log:
    """Return the log in the columns of a file, as `read_log` does; or the head of a stream."""
    return logs_of_joints([(table, columns)], is_stream=is_stream)[0]


def logs_of_joints(
    parts: Sequence[tuple[Table, MapSource | None]], *, is_stream: bool = False
) -> list[Log]:
    """Return the logs of joints in one file; samples that one joint lacks are removed from all."""
    numbers = [f"_{joint}" for joint in range(1, len(parts) + 1)] if len(parts) > 1 else [""]
    drafts = [_draft_of(*part, number) for part, number in zip(parts, numbers, strict=True)]
    keep_common(drafts)
    mend(drafts)
    find_seams(drafts, is_stream=is_stream)
    rest = [len(drafts) > 1 and checks.is_resting(draft) for draft in drafts]
    grid = even_grid(drafts)
    return [
        _log_of(draft, table, grid, rests=own and not all(rest), alone=len(parts) == 1)
        for draft, (table, _), own in zip(drafts, parts, rest, strict=True)
    ]


def _draft_of(table: Table, columns: MapSource | None, number: str) -> Draft:
    """Channels of one joint, without repeated samples, holes and samples of stuck sensors."""
    channels, warnings = read_channels(table, columns)
    log = Draft(table.file, channels, number, [*dict.fromkeys(table.warnings + warnings)])
    checks.check_magnitude(log)
    drop_marks(log)
    drop_zeros(log)
    count_time_over(log)
    count_on(log)
    drop_repeats(log, table)
    drop_holes(log)
    count_positions_over(log)
    integrate_velocities(log)
    checks.drop_frozen(log)
    return log


def integrate_velocities(log: Draft) -> None:
    """Add positions that were not measured, as integrals of measured velocities."""
    for position, other in (ENCODERS, ENCODERS[::-1]):
        velocity = log.channels.get(name := position.replace("position", "velocity"))
        measured = {position} if position == "motor_position" else {position, "deflection"}
        if velocity is None or measured & log.channels.keys():
            continue
        known = log.those_of([other])
        began, start = (f"the first {other}", log[other][0]) if known else ("zero", 0.0)
        values = start + integral(velocity.values, log.time)
        origin = replace(velocity.origin, unit=velocity.unit.removesuffix("/s"))
        log.channels[position] = replace(velocity, values=values, origin=origin)
        log.warn(
            position,
            f"there is no {position}, so {name} was integrated from {began} on: it is off by a "
            f"constant, and a bias makes it drift: subtract the bias by an offset in a column map",
        )
        del log.channels[name]


def drop_marks(log: Draft) -> None:
    """Make holes of numbers that mark missing values, such as -999 far from all others."""
    for name in log.names:
        origin = log.channels[name].origin
        for end in (np.min, np.max, np.min):  # one mark may hide another
            values = log[name]
            known = values[np.isfinite(values)]
            mark = end(known) if len(known) else np.nan
            rest = known[known != mark]
            if not len(rest) or not 0.0 < np.ptp(rest) < np.abs(rest - mark).min():
                continue
            raw = float((mark - origin.offset) / origin.factor)
            if _NINES.fullmatch(f"{raw:.6g}") or np.isclose(abs(raw), _LIMITS, rtol=1e-9).any():
                count, marked = len(known) - len(rest), values == mark
                # Several in a row may be pulses of an input, and more of them a level.
                is_alone = count <= MOST_GAPS * len(values) and not (marked[1:] & marked[:-1]).any()
                is_hole = name not in INPUTS or is_alone
                taken = "was taken for" if is_hole else "may mark"
                log.warn(
                    name,
                    f"{raw:.9g} ({count} times) is far from all other values and {taken} a missing "
                    f"value: leave such cells empty",
                    Rank.DATA,
                )
                log[name] = np.where(is_hole & marked, np.nan, values)


def drop_zeros(log: Draft) -> None:
    """Make holes of zeros far from the values around them, as readings that failed leave."""
    for name in log.names:
        values = log[name]
        zero = log.channels[name].origin.offset
        others = np.flatnonzero((values != zero) & np.isfinite(values))
        # An input with few levels may be off for a moment.
        if len(others) < 2 or (
            name in INPUTS and len(np.unique(values[others])) <= checks.FEW_LEVELS
        ):
            continue
        places = np.flatnonzero(values == zero)
        places = places[(others[0] < places) & (places < others[-1])]
        after = np.searchsorted(others, places)
        ends = others[[after - 1, after]]
        usual = np.median(np.abs(np.diff(values[others])))
        jump = np.maximum(np.ptp(values[ends], axis=0), max(usual, encoder_step(values[others])))
        off = np.abs(values[ends].mean(axis=0) - zero)
        lost = places[(np.ptp(ends, axis=0) <= _LONGEST_ZERO + 1) & (off > _APART * jump)]
        if _FEWEST_ZEROS <= len(lost) <= MOST_GAPS * len(values):
            log.warn(
                name,
                f"is 0 in {len(lost)} samples (at {log.at(lost)}) and far from 0 next to them, so "
                f"these were taken for missing values: leave such cells empty",
                Rank.DATA,
            )
            values = values.copy()
            values[lost] = np.nan
            log[name] = values


def drop_holes(log: Draft) -> None:
    """Remove rows with empty cells if they are few; else resample the channels to one clock."""
    there = {name: ~np.isnan(log[name]) for name in log.names}
    unused = _sparse_velocities(there)
    if unused:
        columns = " and ".join(log.channels[name].place for name in sorted(unused))
        log.warn(columns, "too many values are missing, so it is not used: leave it out")
        for name in unused:
            del log.channels[name], there[name]
    whole = np.logical_and.reduce([*there.values()])
    if whole.all():
        return
    missing = " and ".join(log.channels[name].place for name, own in there.items() if not own.all())
    count = f"no value in {np.count_nonzero(~whole)} of {len(whole)} rows"
    if np.mean(~whole) <= MOST_GAPS:
        log.warn(
            missing,
            f"{count} (at {log.at(np.flatnonzero(~whole))}), which were left out: log every "
            f"channel in every sample",
            Rank.DATA,
        )
        log.keep(whole)
        return
    from flexid.recording.one_clock import Signal, on_one_clock  # rarely needed

    columns = {name: log.channels[name].column for name in there}
    stamps = {columns[name]: log.time[own] for name, own in there.items()}
    signals = [
        Signal(name, columns[name], log[name][own], name in INPUTS) for name, own in there.items()
    ]
    times, found, warnings = on_one_clock(log.file, stamps, signals)
    if np.mean(are_gaps(times)) > MOST_GAPS:
        raise log.refusal(
            missing,
            f"{count}, at uneven times: log every channel in every sample, or at a rate of its own",
        )
    for name, values in {"time": times, **found}.items():
        log[name] = values
    log.warnings += warnings


def _sparse_velocities(there: Mapping[str, NDArray[np.bool_]]) -> set[str]:
    """Velocities without a value in too many of the rows that have all other channels."""
    velocities = {name for name in VELOCITIES if name in there}
    needed = np.logical_and.reduce([own for name, own in there.items() if name not in velocities])
    most = MOST_GAPS * np.count_nonzero(needed)
    return {
        name
        for name in velocities
        if np.count_nonzero(needed & ~there[name]) > most or not there[name].any()
    }


def _log_of(log: Draft, table: Table, grid: Grid, *, rests: bool, alone: bool) -> Log:
    """Log on an even grid, after checks and corrections of its channels."""
    origins = {name: channel.origin for name, channel in log.channels.items()}
    if not rests:
        checks.drop_dead_inputs(log)
        _check_each(log)
    wrapped = unwrap(log)
    _add_link_position(log)
    if not rests:
        _check_together(log)
    recordings = [_recording_of(log, grid, part) for part in grid.recordings]
    backward: dict[str, None] = {}
    while not rests and (names := correct_signs(log, _most_moved(recordings), alone=alone)):
        align(log, wrapped)
        _add_link_position(log)
        recordings = [_recording_of(log, grid, part) for part in grid.recordings]
        origins |= {name: log.channels[name].origin for name in names}
        backward |= dict.fromkeys(names)
    if not rests and are_opposed(_most_moved(recordings)):
        log.warn(ENCODERS, "link and motor position are opposite: check their signs", Rank.SCALE)
    measured = log.those_of(VELOCITIES)
    unused = {name: None for name in measured if not is_used(log, name, recordings)}
    recordings = [replace(recording, **unused) for recording in recordings]
    if not rests:
        check_motion(log, max(recordings, key=len), alone=alone)
    rest = table.sha256, origins, rests, tuple(backward)
    return Log(tuple(recordings), tuple(log.warnings), log.file, *rest)


def _most_moved(recordings: Sequence[Recording]) -> Recording:
    """Recording with the most motion, by the variance of the motor position times the length."""
    return max(recordings, key=lambda one: len(one) * float(np.var(one.motor_position)))


def _check_each(log: Draft) -> None:
    """Check each channel separately; a side that a column map clamps may rest."""
    for name in log.names:
        if log.channels[name].origin.columns:
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
    encoders = [name for name in log.those_of(ENCODERS) if log.channels[name].origin.columns]
    for name in encoders:
        checks.check_moves(log, name)
    for name in log.those_of(INPUTS):
        checks.check_copy(log, name)
        checks.check_power(log, name)
    if len(encoders) == 2:
        checks.check_two_encoders(log)
    for name in encoders:
        checks.check_speed(log, name)


def _recording_of(log: Draft, grid: Grid, part: slice) -> Recording:
    """One part of a log as a recording on an even grid."""
    time = log.time[part]
    drive = next(iter(log.those_of(INPUTS)), "")
    # The last time stamp may precede the last even time by its rounding.
    count = int((time[-1] - time[0]) / grid.sample_time + EVEN) + 1
    even = np.minimum(time[0] + grid.sample_time * np.arange(count), time[-1])

    def sampled(name: str) -> FloatArray | None:
        if name not in log.channels:
            return None
        values = log[name][part]
        return interpolated(time, values, even, held=name == drive) if grid.resample else values

    motor_position = sampled("motor_position")
    assert motor_position is not None
    return Recording(
        sample_time=grid.sample_time,
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
        from_voltage=drive == "motor_voltage" and log.channels[drive].unit != "V",
    )
