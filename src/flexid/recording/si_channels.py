"""Columns as channels in SI units, by recipes that their names or a column map give."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.channel import GEARED, SI_UNITS, Channel, Origin
from flexid.recording.clock import Clock
from flexid.recording.names import did_you_mean, folded, quoted, split_header
from flexid.recording.table import Table
from flexid.recording.units import UnitError, scale_to_si

if TYPE_CHECKING:
    from flexid.recording.column_map import ColumnMap


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
