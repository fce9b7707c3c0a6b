"""Which column of a file is which channel, in which unit: canonical names and the column map."""

from __future__ import annotations

import difflib
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.table import Table, read_bytes
from flexid.recording.units import UnitError, scale_to_si
from flexid.toml_file import parse_toml

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from flexid.recording.column_map import Entry
    from flexid.recording.recording import FloatArray

VELOCITIES = ("link_velocity", "motor_velocity")
INPUTS = ("motor_torque", "motor_current", "motor_voltage")  # in the order of preference
SI_UNITS: dict[str, tuple[str, ...]] = {
    "time": ("s",),
    "link_position": ("rad",),
    "link_velocity": ("rad/s",),
    "motor_position": ("rad",),
    "motor_velocity": ("rad/s",),
    "deflection": ("rad",),
    "motor_torque": ("N m", "V", "A"),
    "motor_current": ("A",),
    "motor_voltage": ("V",),
}
_LINK = "link_position (or deflection)"
LARGEST_MAP = 1_000_000  # bytes


@dataclass(frozen=True, eq=False)
class Channel:
    """One canonical channel of a file, in SI units.

    Parameters
    ----------
    values : FloatArray, shape (n,)
    unit : str
        The SI unit of the values.
    column : str
        The column it came from, as named in the file, or several joined by " + ".
    unit_stated : bool
        Whether the file or the map named a unit.
    """

    values: FloatArray
    unit: str
    column: str
    unit_stated: bool


def read_channels(
    table: Table, map_path: Path | None
) -> tuple[dict[str, Channel], tuple[str, ...]]:
    """Return the canonical channels of a table, in SI units.

    Parameters
    ----------
    table : Table
    map_path : Path or None
        A TOML column map.

    Returns
    -------
    channels : dict of str to Channel
        By canonical name.
    warnings : tuple of str

    Raises
    ------
    RecordingError
        If the map cannot be used, a required column is missing, or a cell or a unit is bad.
    """
    entries = {} if map_path is None else read_map(map_path)
    warnings: list[str] = []
    found = _canonical_columns(table)
    warnings += _require(table, set(found) | set(entries), map_path, _mapped_columns(entries))
    wanted = _wanted(table, set(found) | set(entries), warnings)
    if map_path is None:
        unused = [name for name in table.names if split_header(name)[0] not in SI_UNITS]
        if unused:
            warnings.append(
                f"{table.file}: {_quoted(unused)} not used: name them in a column map if they "
                f"are needed"
            )
    channels = {}
    for name in SI_UNITS:
        if name not in wanted:
            continue
        if name in entries and map_path is not None:
            channels[name] = _mapped(table, name, entries[name], map_path.name)
        else:
            channels[name] = _direct(table, name, found[name])
    return channels, tuple(warnings)


def channel_columns(table: Table, map_path: Path | None) -> list[str]:
    """Headers of the columns that `read_channels` reads, in the file's order."""
    entries = {} if map_path is None else read_map(map_path)
    found = _canonical_columns(table)
    used = set()
    for name in _wanted(table, set(found) | set(entries), []):
        if name in entries and map_path is not None:
            terms = entries[name].terms
            used |= {_find(table, term.column, name, map_path.name) for term in terms}
        else:
            used.add(found[name])
    return [header for header in table.names if header in used]


def split_header(header: str) -> tuple[str, str | None]:
    """Split a header such as ``link_position [deg]`` into its name and its unit.

    >>> split_header("link_position [deg]")
    ('link_position', 'deg')
    >>> split_header("time")
    ('time', None)
    """
    match = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]\s*", header)
    return (match[1].strip(), match[2].strip()) if match else (header.strip(), None)


def read_map(path: Path) -> Mapping[str, Entry]:
    """Read a column map.

    Parameters
    ----------
    path : Path
        A TOML file; its keys are canonical names.

    Returns
    -------
    Mapping of str to Entry

    Raises
    ------
    RecordingError
        If the file is missing, is no TOML, or holds an unknown key or a value that cannot be used.
    """
    from flexid.recording.column_map import parse_entry

    def refuse(_key: str, reason: str) -> RecordingError:
        return RecordingError(path.name, "", f"the column map {reason}")

    raw = read_bytes(path, LARGEST_MAP, "name the column map, not the log")
    content = parse_toml(raw, refuse)
    for key in content:
        if key not in SI_UNITS:
            raise RecordingError(
                path.name,
                f"key {key!r}",
                f"this is no channel{_did_you_mean(key, SI_UNITS)}: use one of "
                f"{', '.join(SI_UNITS)}",
            )
    return {key: parse_entry(path.name, key, value) for key, value in content.items()}


def _canonical_columns(table: Table) -> dict[str, str]:
    """Return the headers of the columns that have canonical names, by that name."""
    found: dict[str, str] = {}
    for header in table.names:
        name = split_header(header)[0]
        if name not in SI_UNITS:
            continue
        if name in found:
            raise RecordingError(
                table.file,
                table.header,
                f"the columns {found[name]!r} and {header!r} are both {name}: remove one of them",
            )
        found[name] = header
    return found


def _mapped_columns(entries: Mapping[str, Entry]) -> set[str]:
    return {split_header(term.column)[0] for entry in entries.values() for term in entry.terms}


def _require(
    table: Table, available: set[str], map_path: Path | None, taken: set[str]
) -> list[str]:
    """Raise unless time, a position and an input are there; warn if the link position is not."""
    choices = {
        "time": ("time",),
        "motor_position": ("motor_position",),
        _LINK: ("link_position", "deflection"),
        "motor_torque (or motor_current, or motor_voltage)": INPUTS,
    }
    missing = [label for label, names in choices.items() if not available.intersection(names)]
    if not missing:
        return []
    bare = [name for name, _ in map(split_header, table.names) if name not in taken]
    hints = [_did_you_mean(label.split(" ")[0], bare) for label in missing]
    labels = ", no ".join(label + hint for label, hint in zip(missing, hints, strict=True))
    what = "a column map" if map_path is None else f"the column map {map_path.name}"
    if missing == [_LINK]:
        return [
            f"{table.file}: there is no {labels}, so only the rigid joint can be identified: to "
            f"identify the compliance, log it or name its column in {what}; found "
            f"{_quoted(table.names)}"
        ]
    raise RecordingError(
        table.file,
        table.header,
        f"there is no {labels}; found {_quoted(table.names)}: rename the columns or say in {what} "
        f"which is which",
    )


def _wanted(table: Table, available: set[str], warnings: list[str]) -> set[str]:
    """Return the channels to read: of several inputs, and of two link positions, only one."""
    wanted = set(available)
    if "link_velocity" in wanted and not wanted & {"link_position", "deflection"}:
        wanted.discard("link_velocity")
        warnings.append(
            f"{table.file}: link_velocity is not used, since there is no link position: log it"
        )
    if {"link_position", "deflection"} <= wanted:
        wanted.discard("deflection")
        warnings.append(
            f"{table.file}: deflection is not used, since the link position is there: remove "
            f"the link position to use it"
        )
    inputs = [name for name in INPUTS if name in wanted]
    for name in inputs[1:]:
        wanted.discard(name)
        warnings.append(
            f"{table.file}: {name} is not used, since {inputs[0]} is there: remove {inputs[0]} "
            f"to use it"
        )
    return wanted


def _direct(table: Table, name: str, header: str) -> Channel:
    """Read a column under its canonical name."""
    unit = split_header(header)[1]
    place = f"{table.header}, column {header!r}" if table.header else f"column {header!r}"
    factor, si_unit = _scale(table.file, place, unit, name)
    values = table.numbers(header)
    if factor != 1.0:
        with np.errstate(over="ignore"):
            values *= factor
    return Channel(values, si_unit, header, unit is not None)


def _mapped(table: Table, name: str, entry: Entry, map_file: str) -> Channel:
    """Compute a channel by its entry in the column map."""
    headers = [_find(table, term.column, name, map_file) for term in entry.terms]
    units = {split_header(header)[1] for header in headers}
    if entry.unit is None and len(units) > 1:
        raise RecordingError(
            map_file,
            f"key '{name}'",
            f"the columns {_quoted(headers)} differ in unit: scale them to one and name it by "
            f"'unit'",
        )
    unit = entry.unit if entry.unit is not None else units.pop()
    factor, si_unit = _scale(map_file, f"key '{name}'", unit, name)
    total = np.zeros(table.frame.height)
    with np.errstate(over="ignore", invalid="ignore"):  # absurd values are refused later
        for term, header in zip(entry.terms, headers, strict=True):
            total += term.scale * table.numbers(header)
        values = factor * (entry.scale * total + entry.offset)
    return Channel(values, si_unit, " + ".join(headers), unit is not None)


def _scale(file: str, place: str, unit: str | None, name: str) -> tuple[float, str]:
    if unit is None:
        return 1.0, SI_UNITS[name][0]
    try:
        return scale_to_si(unit, SI_UNITS[name])
    except UnitError as error:
        raise RecordingError(file, place, str(error)) from error


def _find(table: Table, column: str, name: str, map_file: str) -> str:
    """Return the header of a column that the map names in full or without its unit."""
    if column in table.names:
        return column
    matches = [header for header in table.names if split_header(header)[0] == column]
    if len(matches) == 1:
        return matches[0]
    if matches:
        reason = f"{_quoted(matches)} both match {column!r}: write the name with its unit"
    else:
        hint = _did_you_mean(column, [split_header(header)[0] for header in table.names])
        reason = f"{table.file} has no column {column!r}{hint}: name one of {_quoted(table.names)}"
    raise RecordingError(map_file, f"key '{name}'", reason)


def _did_you_mean(word: str, candidates: Iterable[str]) -> str:
    by_lower = {candidate.lower(): candidate for candidate in candidates}
    close = difflib.get_close_matches(word.lower(), by_lower, n=1, cutoff=0.75)
    return f" (did you mean {by_lower[close[0]]!r}?)" if close else ""


def _quoted(names: Iterable[str]) -> str:
    shown = [repr(name if len(name) <= 40 else name[:37] + "...") for name in names]
    if len(shown) > 20:
        shown = [*shown[:20], f"and {len(shown) - 20} more"]
    return ", ".join(shown)
