"""Columns as channels in SI units, by recipes that their names or a column map give."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.channel import GEARED, SI_UNITS, Channel, Origin
from flexid.recording.clock import Clock
from flexid.recording.names import did_you_mean, folded, quoted, split_header
from flexid.recording.table import Table
from flexid.recording.units import UnitError, scale_to_si

if TYPE_CHECKING:
    from flexid.recording.column_map import Entry


ARGUMENT = "columns"  # what messages call a map that is no file: the argument by which it is given


@dataclass(frozen=True)
class ColumnMap:
    """What a column map says."""

    file: str  # its path, for messages; `ARGUMENT` where it is no file
    entries: Mapping[str, Entry]  # by channel
    gear_ratio: float | None = None  # turns of the motor in one of the link; < 0: opposite ones
    sample_time: float | None = None  # s between rows, where no column holds the time
    unread: frozenset[str] = frozenset()  # channels that are not read, whatever columns there are

    @property
    def described(self) -> str:
        """What it is, for a message that says where to name a column."""
        return self.file if self.file == ARGUMENT else f"the column map {self.file}"

    def gear(self, channel: str) -> float | None:
        """The gear ratio by which a channel is carried to the link's side; None if it is there."""
        entry = self.entries.get(channel)
        if channel not in GEARED or (entry is not None and entry.side == "link"):
            return None
        return self.gear_ratio


class Recipe(NamedTuple):
    """How a channel is made: ``scale * (sum of weight * column) + offset``, in `unit`."""

    weights: dict[str, float]  # by header
    file: str  # where the recipe stands, for messages
    place: str
    gear: float | None = None  # the ratio that may act on the channel
    unit: str | None = None  # None: as the headers say, or SI
    scale: float = 1.0
    offset: float = 0.0
    is_mapped: bool = False  # whether a column map gives it, not a name

    @property
    def header(self) -> str:
        """The first column."""
        return next(iter(self.weights))


def recipe_of_column(table: Table, header: str, unit: str | None, nanoseconds: str = "") -> Recipe:
    """The recipe of a column by its name, with that of a stamp's nanoseconds, if there is one."""
    place = f"{table.header}, column {header!r}" if table.header else f"column {header!r}"
    weights = {header: 1.0, **({nanoseconds: 1e-9} if nanoseconds else {})}
    return Recipe(weights, table.file, place, unit=unit)


def recipe_of_map(table: Table, name: str, column_map: ColumnMap) -> Recipe:
    """The recipe that a column map gives."""
    entry, file = column_map.entries[name], column_map.file
    weights: dict[str, float] = {}
    for term in entry.terms:
        header = _find_header(table, term.column, name, file)
        if header in weights:
            reason = f"'sum' has the column {header!r} twice: give it once, with a scale"
            raise RecordingError(file, f"key '{name}'", reason)
        weights[header] = term.scale
    return Recipe(
        weights,
        file,
        f"key '{name}'",
        column_map.gear(name),
        entry.unit,
        entry.scale,
        entry.offset,
        is_mapped=True,
    )


def counted_time(column_map: ColumnMap) -> Recipe:
    """The time of rows that are so far apart as a column map says."""
    seconds = column_map.sample_time
    assert seconds is not None
    return Recipe({}, column_map.file, "key 'sample_time'", scale=seconds, is_mapped=True)


def made(table: Table, name: str, recipe: Recipe, clock: Clock) -> Channel:
    """A channel by its recipe; raise where a cell or a unit is bad."""
    headers = [*recipe.weights]
    if not headers:
        values = recipe.scale * clock.counted(table.frame.height)
        origin = Origin({}, recipe.scale, 0.0, "s", None)
        return Channel(values, "s", "sample_time", True, origin)
    if name == "time":
        for header in headers:
            stamps = clock.stamped(table, header)
            if stamps is not None:  # they have no unit, whatever stands beside their name
                _check_plain(recipe, header)
                return Channel(
                    stamps, "s", header, True, Origin({header: 1.0}, 1.0, 0.0, "s", None)
                )
    unit = _unit(recipe)
    factor, si_unit = 1.0, SI_UNITS[name][0]
    if unit is not None:
        try:
            factor, si_unit = scale_to_si(unit, SI_UNITS[name])
        except UnitError as error:
            raise RecordingError(recipe.file, recipe.place, str(error)) from error
    gear = None if name not in GEARED or si_unit in ("V", "A") else recipe.gear
    if gear is not None:
        factor *= gear if name == "motor_torque" else 1.0 / gear
    total = np.zeros(table.frame.height)
    with np.errstate(over="ignore", invalid="ignore"):  # absurd values are refused later
        for header, weight in recipe.weights.items():
            if name == "time":  # counted from its beginning, if that is long ago
                numbers = clock.numbers(table, header, factor * recipe.scale * weight)
            else:
                numbers = table.numbers(header, holes=True)
            total += weight * numbers
        values = factor * (recipe.scale * total + recipe.offset)
    scale, offset = factor * recipe.scale, factor * recipe.offset
    origin = Origin(recipe.weights, scale, offset, si_unit, gear)
    return Channel(values, si_unit, " + ".join(headers), unit is not None, origin)


def _unit(recipe: Recipe) -> str | None:
    """The unit that a recipe or its headers state."""
    if recipe.unit is not None:
        return recipe.unit
    units = {split_header(header)[1] for header in recipe.weights}
    if len(units) > 1:
        raise RecordingError(
            recipe.file,
            recipe.place,
            f"the columns {quoted(recipe.weights)} differ in unit: scale them to one and name it "
            f"by 'unit'",
        )
    return units.pop()


def _check_plain(recipe: Recipe, header: str) -> None:
    """Raise where a column map computes with time stamps."""
    is_scaled = [*recipe.weights.values()] != [1.0] or recipe.scale != 1.0 or recipe.offset
    if recipe.is_mapped and (is_scaled or recipe.unit not in (None, "s")):
        raise RecordingError(
            recipe.file,
            recipe.place,
            f"the column {header!r} holds time stamps, which are read as they are: give its name "
            f"alone",
        )


def _find_header(table: Table, column: str, name: str, map_file: str) -> str:
    """The header that a map names: exactly, without its unit, or in other letters."""
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
    reason = f"{table.file} has no column {column!r}{hint}: name one of {table.listing}"
    raise RecordingError(map_file, f"key '{name}'", reason)
