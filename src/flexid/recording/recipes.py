"""Recipes that compute channels in SI units from columns, given by names or a column map."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from sys import float_info
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from flexid.errors import RecordingError
from flexid.files import parse_toml, read_small, shown
from flexid.models.motion import JOINT_TYPES, JointType, unit_of
from flexid.recording.names import cut, folded, nearest_name, quoted, split_header
from flexid.recording.recording import (
    ENCODERS,
    GEARED,
    INPUTS,
    LONGEST_SAMPLE_TIME,
    SHORTEST_SAMPLE_TIME,
    SI_UNITS,
    Channel,
    Origin,
    si_units,
)
from flexid.recording.table import Clock, Table
from flexid.recording.units import UnitError, is_of_a_slide, scale_to_si

MapSource: TypeAlias = Path | Mapping[str, object]
"""A TOML file with a column map, or a mapping with the same keys and values."""

ARGUMENT = "columns"  # name in messages of a map that was given as an argument
REMEDY = (
    "write a column name, a table of column or sum, scale, offset, unit and side, or false to "
    "leave a channel out"
)
_RATIO = re.compile(r"\s*([+-]?\d+(?:\.\d+)?)\s*[/:]\s*(\d+(?:\.\d+)?)\s*")
NO_GEAR = "it is for a joint that turns: write the lead, in m per turn of the motor, in its place"
_NUMBERS = {  # settings of the joint: least and greatest value, and the message for any other
    "gear_ratio": (
        *(1.0, 1e6),
        'not a ratio: write the turns of the motor per turn of the link, as 101 or "1/101"',
    ),
    "lead": (
        *(1e-6, 100.0),
        "not a lead: write the travel of the link in m per turn of the motor, as 0.005 for a screw "
        "of 5 mm",
    ),
    "sample_time": (
        *(SHORTEST_SAMPLE_TIME, LONGEST_SAMPLE_TIME),
        f"not a sample time from {SHORTEST_SAMPLE_TIME:g} to {LONGEST_SAMPLE_TIME:g} s: write the "
        f'seconds between two rows, as 0.001 or "1/1000"',
    ),
}


class Recipe(NamedTuple):
    """How a channel is made: ``scale * (sum of weight * column) + offset``, in `unit`."""

    weights: dict[str, float]  # by column: by its header, or by its name in a column map
    file: str  # file and place of the recipe, for messages
    place: str
    unit: str | None = None  # None: that of the headers, or SI
    scale: float = 1.0  # in `unit` per raw unit
    offset: float = 0.0  # in `unit`
    ratio: float | None = None  # of motor and link, if it may apply to the channel
    joint: JointType = "revolute"  # type of the channel's joint
    is_mapped: bool = False  # whether it comes from a column map instead of a name

    @property
    def header(self) -> str:
        """Header of the first column."""
        return next(iter(self.weights))

    def refusal(self, reason: str) -> RecordingError:
        """Return the error that refuses the channel."""
        return RecordingError(self.file, self.place, reason)


@dataclass(frozen=True)
class ColumnMap:
    """Content of a column map."""

    file: str  # its path, for messages; `ARGUMENT` for a mapping
    recipes: Mapping[str, Recipe]  # by channel; columns by their names in the map
    # turns of the motor per turn of the link, or its rad per m; negative if reversed
    ratio: float | None
    unread: frozenset[str]  # channels that are not read, even if there are columns
    joint: JointType | None = None  # None: by the units of the columns

    @property
    def clamped(self) -> frozenset[str]:
        """Positions of clamped sides, for which no column is read."""
        return frozenset(n for n, one in self.recipes.items() if n != "time" and not one.weights)

    def recipe(self, table: Table, name: str) -> Recipe:
        """Return the recipe of a channel with the headers of a file as its columns."""
        recipe = self.recipes[name]
        found = ((_find_header(table, c, recipe), w) for c, w in recipe.weights.items())
        return recipe._replace(weights=_weights(self.file, name, found))


def read_map(source: MapSource) -> ColumnMap:
    """Return the column map in a TOML file or a mapping."""
    if isinstance(source, Mapping):
        return _map_of(ARGUMENT, dict(source))
    return _map_of(shown(source), map_in_file(source))


def map_in_file(path: Path) -> dict[str, Any]:
    """Return the keys and values of a column map in a TOML file."""

    def refuse(_key: str, reason: str) -> RecordingError:
        return RecordingError(shown(path), "", reason)

    raw = read_small(path, "a column map in TOML", refuse)
    return parse_toml(raw, lambda _, reason: refuse("", _not_a_map(raw, reason)))


def _not_a_map(raw: bytes, reason: str) -> str:
    """Reason for refusing a file that is not TOML as a column map."""
    first = raw.lstrip().partition(b"\n")[0]
    if b"=" not in first and not first.startswith((b"#", b"[")):
        return (
            "this is not a column map, but perhaps the log: give --columns a TOML file such as "
            "examples/columns_voltage_arm.toml, and the log without an option"
        )
    return f"the column map {reason}"


def _map_of(file: str, content: dict[str, Any]) -> ColumnMap:
    """Column map from its keys and values."""
    if not content:
        raise RecordingError(file, "", "the column map is empty: name the columns in it")
    joint = content.pop("joint", None)
    if joint not in (None, *JOINT_TYPES):
        types = " or ".join(map(repr, JOINT_TYPES))
        reason = f"{cut(repr(joint))} is not a joint type: write {types}"
        raise RecordingError(file, "key 'joint'", reason)
    ratio, lead, seconds = (_number_of(file, content, k) for k in _NUMBERS)
    if lead is not None and joint == "revolute":
        raise RecordingError(file, "key 'lead'", "it is for a prismatic joint: leave out joint")
    if ratio is not None and (lead is not None or joint == "prismatic"):
        raise RecordingError(file, "key 'gear_ratio'", NO_GEAR)
    if lead is not None:
        joint, ratio = "prismatic", 2.0 * np.pi / lead
    if seconds is not None and content.get("time", False) is not False:
        reason = "the map names a column for the time, too: leave one of the two out"
        raise RecordingError(file, "key 'sample_time'", reason)
    for key in content:
        if key not in SI_UNITS:
            raise RecordingError(
                file,
                f"key {key!r}",
                f"this is not a channel{nearest_name(str(key), SI_UNITS)}: use one of "
                f"{', '.join(SI_UNITS)}, joint, gear_ratio, lead or sample_time",
            )
    unread = frozenset(key for key, value in content.items() if value is False)
    recipes = {k: _entry(file, k, v, ratio) for k, v in content.items() if k not in unread}
    if seconds is not None:
        place = "key 'sample_time'"
        recipes["time"] = Recipe({}, file, place, scale=seconds, is_mapped=True)
    return ColumnMap(file, recipes, ratio, unread, joint)


def _entry(file: str, name: str, value: object, ratio: float | None) -> Recipe:
    """Recipe from one entry of a column map; a number is the position of a clamped side."""
    if name in ENCODERS and _is_number(value):
        place = f"key '{name}'"
        return Recipe({}, file, place, offset=float(_quotient(value)), is_mapped=True)
    entry = _checked(file, name, value, [*_ENTRY_KEYS])
    if ("column" in entry) == bool(entry.get("sum")):
        raise _entry_error(file, name, "exactly one of 'column' and 'sum' is needed")
    side = entry.get("side")
    if side and (ratio is None or name not in GEARED):
        what = "has a side, but the map no gear_ratio" if name in GEARED else "has no side"
        reason = f"{name} {what}: a side is for {', '.join(GEARED)} in a map with a gear_ratio"
        raise RecordingError(file, f"key '{name}.side'", reason)
    terms = [
        _checked(file, f"{name}.sum.{number}", term, ["column", "scale"])
        for number, term in enumerate(entry.get("sum", [entry.get("column")]))
    ]
    return Recipe(
        _weights(file, name, ((t["column"], _quotient(t.get("scale", 1.0))) for t in terms)),
        file,
        f"key '{name}'",
        entry.get("unit"),
        _quotient(entry.get("scale", 1.0)),
        _quotient(entry.get("offset", 0.0)),
        None if side == "link" else ratio,
        is_mapped=True,
    )


def _is_number(value: object) -> bool:
    number = _quotient(value)
    is_bool = isinstance(number, bool)
    return isinstance(number, int | float) and not is_bool and abs(number) <= float_info.max


_ENTRY_KEYS: dict[str, tuple[Callable[[Any], bool], str]] = {  # by key: test of its value, text
    "column": (lambda value: isinstance(value, str), "the name of a column"),
    "sum": (lambda value: isinstance(value, list | tuple), "a list of columns"),
    "scale": (_is_number, "a finite number"),
    "offset": (_is_number, "a finite number"),
    "unit": (lambda value: isinstance(value, str | None), "the name of a unit"),
    "side": (lambda value: value is None or str(value) in ("motor", "link"), "'motor' or 'link'"),
}


def _checked(file: str, place: str, value: object, keys: list[str]) -> Mapping[str, Any]:
    """Entry of a map, or term of a sum, as a table; raise if a key or a value is wrong."""
    table = {"column": value} if isinstance(value, str) else value
    if not isinstance(table, Mapping):
        raise _entry_error(file, place, "this is neither a column name nor a table")
    for key, held in table.items():
        if key not in keys:
            raise _entry_error(file, f"{place}.{key}", "this key is not known")
        is_right, what = _ENTRY_KEYS[key]
        if not is_right(held):
            raise _entry_error(file, f"{place}.{key}", f"{cut(repr(held))} is not {what}")
    if "column" not in table and "sum" not in keys:
        raise _entry_error(file, place, "a column is needed")
    return table


def _entry_error(file: str, place: str, reason: str) -> RecordingError:
    return RecordingError(file, f"key '{place}'", f"{reason}: {REMEDY}")


def _weights(file: str, name: str, terms: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Weights by column; raise if a sum has a column twice."""
    weights: dict[str, float] = {}
    for column, factor in terms:
        if column in weights:
            reason = f"'sum' has the column {column!r} twice: give it once, with a scale"
            raise RecordingError(file, f"key '{name}'", reason)
        weights[column] = float(factor)
    return weights


def _quotient(value: Any) -> Any:
    """Convert a NumPy number, or a text such as "1/101", to a number; return all else unchanged."""
    if isinstance(value, Real) and not isinstance(value, bool | int):
        return float(value)
    match = _RATIO.fullmatch(value) if isinstance(value, str) else None
    return float(match[1]) / float(match[2]) if match and float(match[2]) else value


def _number_of(file: str, content: dict[str, Any], key: str) -> float | None:
    """Take a setting of the joint from a map; raise if its value is out of range."""
    value = content.pop(key, None)
    if value is None:
        return None
    number, (least, most, remedy) = _quotient(value), _NUMBERS[key]
    if key == "gear_ratio" and isinstance(value, str) and isinstance(number, float):
        number = 1.0 / number if 0.0 < abs(number) < 1.0 else number
    is_signed = key != "sample_time"
    if _is_number(number) and least <= (abs(number) if is_signed else number) <= most:
        return float(number)
    raise RecordingError(file, f"key {key!r}", f"{cut(repr(value))} is {remedy}")


def _find_header(table: Table, column: str, recipe: Recipe) -> str:
    """Header that a map names: exactly, without its unit, or ignoring case and word breaks."""
    bare = {header: split_header(header)[0] for header in table.names}
    for fits in (
        lambda header: header == column,
        lambda header: bare[header] == column,
        lambda header: (
            folded(column) in (folded(header), folded(bare[header]))
            or column == split_header(table.short_name(header))[0]
        ),
    ):
        matches = [header for header in table.names if fits(header)]
        if len(matches) == 1:
            return matches[0]
        if matches:
            found = f"{quoted(matches)} both match {column!r}"
            raise recipe.refusal(f"{found}: write the name as in the file")
    hint = nearest_name(column, bare.values())
    found = f"{table.file} has no column {column!r}{hint}"
    raise recipe.refusal(f"{found}: name one of {table.listing}")


def recipe_of_column(table: Table, header: str, unit: str | None) -> Recipe:
    """Return the recipe of a column that was found by its name."""
    place = f"{table.header}, column {header!r}" if table.header else f"column {header!r}"
    return Recipe({header: 1.0}, table.file, place, unit)


def joint_of(recipes: Iterable[Recipe], usual: JointType = "revolute") -> JointType:
    """Return the type of a joint by the units of its columns: prismatic if any is in m or N."""
    stated = [unit for recipe in recipes if recipe.weights and (unit := _unit(recipe))]
    if not stated:
        return usual
    return "prismatic" if any(map(is_of_a_slide, stated)) else "revolute"


def make_channel(table: Table, name: str, recipe: Recipe, clock: Clock) -> Channel:
    """Return the channel that a recipe makes of a table; raise if a cell or a unit is wrong."""
    if not recipe.weights and name != "time":
        values = np.full(table.frame.height, recipe.offset)
        unit = si_units(name, recipe.joint)[0]
        return Channel(values, name, True, Origin({}, 1.0, recipe.offset, unit, None))
    if not recipe.weights:
        values = recipe.scale * clock.counted(table.frame.height)
        return Channel(values, "sample_time", True, Origin({}, recipe.scale, 0.0, "s", None))
    for header in recipe.weights if name == "time" else ():
        stamps = clock.stamped(table, header)
        if stamps is not None:  # a unit in the header does not apply to time stamps
            _check_plain(recipe, header)
            return Channel(stamps, header, True, Origin({header: 1.0}, 1.0, 0.0, "s", None))
    unit = _unit(recipe)
    if name == "time" and unit is None:
        unit = clock.unit_of_count(table, recipe.header)
    factor, si_unit, ratio = _in_si(name, recipe, unit)
    if ratio is not None:
        factor *= ratio if name in INPUTS else 1.0 / ratio
    total = np.zeros(table.frame.height)
    with np.errstate(over="ignore", invalid="ignore"):  # absurd values are refused later
        for header, weight in recipe.weights.items():
            if name == "time":  # counted from the first, for precision
                numbers = clock.numbers(table, header, factor * recipe.scale * weight)
            else:
                numbers = table.numbers(header, holes=True)
            total += weight * numbers
        values = factor * (recipe.scale * total + recipe.offset)
    scale, offset = factor * recipe.scale, factor * recipe.offset
    origin = Origin(recipe.weights, scale, offset, si_unit, ratio)
    return Channel(values, " + ".join(recipe.weights), unit is not None, origin)


def _in_si(name: str, recipe: Recipe, unit: str | None) -> tuple[float, str, float | None]:
    """Factor and SI unit of a channel, and the ratio that converts it to the link's side."""
    units, ratio = si_units(name, recipe.joint), recipe.ratio if name in GEARED else None
    if unit is None:
        factor, si_unit = 1.0, units[0]
        if ratio is not None and si_unit != SI_UNITS[name][0]:
            raise recipe.refusal(
                f"it has no unit, and the lead applies only to a motor that turns: write the unit, "
                f"{SI_UNITS[name][0]} or {si_unit}"
            )
    else:
        # On a linear axis, the units of the motor that turns its screw or pulley.
        turning = SI_UNITS[name] if ratio is not None else ()
        try:
            factor, si_unit = scale_to_si(unit, tuple(dict.fromkeys((*units, *turning))))
        except UnitError as error:
            raise recipe.refusal(str(error)) from error
    slides = unit_of(si_unit, recipe.joint)
    is_geared = slides != si_unit or (recipe.joint == "revolute" and si_unit not in ("V", "A"))
    return factor, slides, ratio if is_geared else None


def _unit(recipe: Recipe) -> str | None:
    """Unit that a recipe or its headers state; raise if the headers differ."""
    if recipe.unit is not None:
        return recipe.unit
    units = {split_header(header)[1] for header in recipe.weights}
    if len(units) > 1:
        columns = quoted(recipe.weights)
        raise recipe.refusal(
            f"the columns {columns} differ in unit: scale them to one and name it by 'unit'"
        )
    return units.pop()


def _check_plain(recipe: Recipe, header: str) -> None:
    """Raise if a column map scales or shifts time stamps."""
    is_scaled = [*recipe.weights.values()] != [1.0] or recipe.scale != 1.0 or recipe.offset
    if recipe.is_mapped and (is_scaled or recipe.unit not in (None, "s")):
        raise recipe.refusal(
            f"the column {header!r} holds time stamps, which are read as they are: give its name "
            f"alone"
        )
