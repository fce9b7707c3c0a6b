"""Columns as channels in SI units: by their names, or as a column map computes them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.channel import GEARED, SI_UNITS, Channel, Origin
from flexid.recording.names import did_you_mean, folded, quoted, split_header
from flexid.recording.units import UnitError, scale_to_si

if TYPE_CHECKING:
    from flexid.arrays import FloatArray
    from flexid.recording.clock import Clock
    from flexid.recording.column_map import ColumnMap, Entry
    from flexid.recording.table import Table


def direct(
    table: Table, name: str, header: str, unit: str | None, gear: float | None, clock: Clock
) -> Channel:
    """A column under the name of a channel, with the unit that its name states."""
    if name == "time":
        stamps = clock.stamped(table, header)
        if stamps is not None:
            return _of_stamps(header, stamps)
    place = f"{table.header}, column {header!r}" if table.header else f"column {header!r}"
    factor, si_unit = _scale(table.file, place, unit, name)
    gear, geared = _geared(name, si_unit, gear)
    factor *= geared
    values = _numbers(table, name, header, factor, clock)
    if factor != 1.0:
        with np.errstate(over="ignore"):
            values *= factor
    origin = Origin({header: 1.0}, factor, 0.0, si_unit, gear)
    return Channel(values, si_unit, header, unit is not None, origin)


def mapped(table: Table, name: str, column_map: ColumnMap, clock: Clock) -> Channel:
    """Compute a channel by its entry in the column map."""
    entry, map_file = column_map.entries[name], column_map.file
    headers = [find_header(table, term.column, name, map_file) for term in entry.terms]
    for header in headers:
        if headers.count(header) > 1:
            reason = f"'sum' has the column {header!r} twice: give it once, with a scale"
            raise RecordingError(map_file, f"key '{name}'", reason)
    if name == "time":
        for header in headers:
            stamps = clock.stamped(table, header)
            if stamps is not None:
                _check_plain(entry, header, map_file)
                return _of_stamps(header, stamps)
    units = {split_header(header)[1] for header in headers}
    if entry.unit is None and len(units) > 1:
        raise RecordingError(
            map_file,
            f"key '{name}'",
            f"the columns {quoted(headers)} differ in unit: scale them to one and name it by "
            f"'unit'",
        )
    unit = entry.unit if entry.unit is not None else units.pop()
    factor, si_unit = _scale(map_file, f"key '{name}'", unit, name)
    gear, geared = _geared(name, si_unit, column_map.gear(name))
    factor *= geared
    total = np.zeros(table.frame.height)
    with np.errstate(over="ignore", invalid="ignore"):  # absurd values are refused later
        for term, header in zip(entry.terms, headers, strict=True):
            scale = factor * entry.scale * term.scale
            total += term.scale * _numbers(table, name, header, scale, clock)
        values = factor * (entry.scale * total + entry.offset)
    weights = {header: term.scale for term, header in zip(entry.terms, headers, strict=True)}
    origin = Origin(weights, factor * entry.scale, factor * entry.offset, si_unit, gear)
    return Channel(values, si_unit, " + ".join(headers), unit is not None, origin)


def _numbers(table: Table, name: str, header: str, scale: float, clock: Clock) -> FloatArray:
    """A column's numbers; the time's are counted from its beginning, if that is long ago."""
    return clock.numbers(table, header, scale) if name == "time" else table.numbers(header)


def _of_stamps(header: str, seconds: FloatArray) -> Channel:
    """The time that stamps show, which have no unit, whatever stands beside their name."""
    return Channel(seconds, "s", header, True, Origin({header: 1.0}, 1.0, 0.0, "s", None))


def _check_plain(entry: Entry, header: str, map_file: str) -> None:
    """Raise where a column map computes with time stamps."""
    scaled = any(term.scale != 1.0 for term in entry.terms) or entry.scale != 1.0 or entry.offset
    if len(entry.terms) > 1 or scaled or entry.unit not in (None, "s"):
        raise RecordingError(
            map_file,
            "key 'time'",
            f"the column {header!r} holds time stamps, which are read as they are: give its name "
            f"alone",
        )


def _geared(name: str, si_unit: str, gear: float | None) -> tuple[float | None, float]:
    """The gear ratio that acts on a channel, and the factor that it makes."""
    if gear is None or name not in GEARED or si_unit in ("V", "A"):
        return None, 1.0
    return gear, gear if name == "motor_torque" else 1.0 / gear


def _scale(file: str, place: str, unit: str | None, name: str) -> tuple[float, str]:
    if unit is None:
        return 1.0, SI_UNITS[name][0]
    try:
        return scale_to_si(unit, SI_UNITS[name])
    except UnitError as error:
        raise RecordingError(file, place, str(error)) from error


def find_header(table: Table, column: str, name: str, map_file: str) -> str:
    """Return the header that the map names: exactly, without its unit, or in other letters."""
    bare = {header: split_header(header)[0] for header in table.names}
    for matches in (
        [header for header in table.names if header == column],
        [header for header in table.names if bare[header] == column],
        [
            header
            for header in table.names
            if folded(column) in (folded(header), folded(bare[header]))
            or column == split_header(table.short_name(header))[0]
        ],
    ):
        if len(matches) == 1:
            return matches[0]
        if matches:
            reason = f"{quoted(matches)} both match {column!r}: write the name as in the file"
            raise RecordingError(map_file, f"key '{name}'", reason)
    hint = did_you_mean(column, bare.values())
    raise RecordingError(
        map_file,
        f"key '{name}'",
        f"{table.file} has no column {column!r}{hint}: name one of {table.listing}",
    )
