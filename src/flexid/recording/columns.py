"""Which column of a file is which channel, in which unit: by names, or by a column map."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import isclose
from typing import TYPE_CHECKING, Any

from flexid.errors import RecordingError
from flexid.recording.channel import INPUTS, SI_UNITS, Channel
from flexid.recording.clock import Clock, is_stamp
from flexid.recording.names import (
    LONGEST,
    Usual,
    common_words,
    did_you_mean,
    folded,
    may_be_input,
    named_channel,
    quoted,
    split_header,
    usual_channel,
)
from flexid.recording.si_channels import (
    ColumnMap,
    Recipe,
    counted_time,
    made,
    recipe_of_column,
    recipe_of_map,
)
from flexid.recording.table import Table
from flexid.recording.units import UnitError, is_relative, scale_to_si

if TYPE_CHECKING:
    from flexid.recording.column_map import MapSource

_LINK = "link_position (or deflection)"
_INPUT = "motor_torque (or motor_current, or motor_voltage)"
_OPTIONAL = (_LINK, _INPUT)
_NANOSECONDS = re.compile(r"(.{0,200})(?:nano|n)(secs?|seconds)$")
_MOST_CHANNELS = 64  # rows in which each channel of a log comes once, where a row holds one
_BY_FOLDED = {name.replace("_", ""): name for name in SI_UNITS}
_NO_MAP = ColumnMap("", {})


@dataclass
class _Plan:
    """Where each channel comes from: from the map, or from a column by its name."""

    column_map: ColumnMap
    found: dict[str, Recipe]  # by the names of columns
    warnings: list[str] = field(default_factory=list)

    @property
    def available(self) -> set[str]:
        counted = {"time"} if self.column_map.sample_time is not None else set()
        return {*self.found, *self.column_map.entries, *counted}


def read_channels(
    table: Table, columns: MapSource | None
) -> tuple[dict[str, Channel], tuple[str, ...]]:
    """Channels of a table in SI units by canonical name, and warnings."""
    recipes, warnings = recipes_of(table, columns)
    return channels_of(table, recipes, Clock()), warnings


def channels_of(table: Table, recipes: Mapping[str, Recipe], clock: Clock) -> dict[str, Channel]:
    """Channels of a table, or of a part of one, by recipes of its names."""
    return {name: made(table, name, recipe, clock) for name, recipe in recipes.items()}


def recipes_of(
    table: Table, columns: MapSource | None
) -> tuple[dict[str, Recipe], tuple[str, ...]]:
    """How each channel that is read is made, and warnings."""
    column_map = _NO_MAP
    if columns is not None:
        from flexid.recording.column_map import read_map

        column_map = read_map(columns)
    named = {*column_map.entries, *column_map.unread}
    plan = _Plan(column_map, _canonical_columns(table, named))
    if column_map is _NO_MAP:
        _add_usual(table, plan)
    _require(table, plan)
    recipes = {}
    for name in sorted(_wanted(table, plan), key=[*SI_UNITS].index):
        if name in column_map.entries:
            recipes[name] = recipe_of_map(table, name, column_map)
        elif name == "time" and column_map.sample_time is not None:
            recipes[name] = counted_time(column_map)
        else:
            recipes[name] = plan.found[name]._replace(gear=column_map.gear(name))
    if column_map is _NO_MAP and not table.kinds:  # a bag holds much that no joint needs
        taken = {header for recipe in plan.found.values() for header in recipe.weights}
        unused = [name for name in table.names if name not in taken]
        if unused:
            are = "is" if len(unused) == 1 else "are"
            plan.warnings.append(
                f"{table.file}: {quoted(unused)} {are} not used: a column map may name what "
                f"is needed"
            )
    return recipes, tuple(plan.warnings)


def is_by_name(channel: str, origin: Mapping[str, Any]) -> bool:
    """Whether a column's name alone says how a channel was computed.

    >>> usual = {"columns": {"q_link [deg]": 1.0}, "factor": 0.017453292519943295, "offset": 0.0}
    >>> is_by_name("link_position", {**usual, "gear_ratio": None})
    True
    >>> is_by_name("link_position", {**usual, "gear_ratio": 100.0})
    False
    """
    if [*origin["columns"].values()] != [1.0] or origin["offset"] or origin["gear_ratio"]:
        return False
    (header,) = origin["columns"]
    starts = [0, *(match.end() for match in re.finditer(r"[./]", header[:LONGEST]))]
    return any(_says(header[start:], channel, origin["factor"]) for start in starts)


def _says(name: str, channel: str, factor: float) -> bool:
    """Whether a name, or the end of a path, stands for a channel in a unit with this factor."""
    bare, unit = split_header(name)
    if _BY_FOLDED.get(folded(bare).replace("_", "")) != channel:
        usual = usual_channel(name)
        if usual is None or not channel.endswith(usual[0]):  # a side is not always named
            return False
        unit = usual[1]
    if unit is None:
        return factor == 1.0
    try:
        return isclose(scale_to_si(unit, SI_UNITS.get(channel, ()))[0], factor)
    except UnitError:
        return False


def _canonical_columns(table: Table, named: set[str]) -> dict[str, Recipe]:
    """The columns that have canonical names, by these, but for those that a column map is about."""
    found: dict[str, Recipe] = {}
    for header in table.names:
        bare, unit = split_header(table.short_name(header))
        name = _BY_FOLDED.get(folded(bare).replace("_", ""))
        if name is None or name in named:
            continue
        if name in found:
            raise RecordingError(
                table.file,
                table.header,
                f"the columns {found[name].header!r} and {header!r} are both {name}: rename or "
                f"remove one of them",
            )
        found[name] = recipe_of_column(table, header, unit)
    return found


def _add_usual(table: Table, plan: _Plan) -> None:
    """Add columns that have usual names where no column has the channel's own."""
    stamp = _stamp_of_two(table)
    candidates = _candidates(table, plan, stamp.weights if stamp else ())
    if stamp and "time" not in candidates:
        candidates["time"] = [(stamp, Usual("time", "s"))]
    skipped = set(plan.found)
    if skipped & set(INPUTS):
        skipped |= set(INPUTS)
    if "deflection" in skipped:
        skipped.add("link_position")
    added: dict[str, Recipe] = {}
    commands = []
    for name in SI_UNITS:
        columns = [] if name in skipped else candidates.get(name, [])
        if len(columns) > 1:
            raise RecordingError(
                table.file,
                table.header,
                f"{quoted(column.header for column, _ in columns)} could each be {name}: rename "
                f"the one that is, or say in a column map which it is",
            )
        if columns:
            added[name], usual = columns[0]
            commands += [added[name].header] if usual.is_command else []
    if "time" not in {*plan.found, *added}:
        stamped = [name for name in table.names if _has_stamps(table, name)]
        added |= {"time": recipe_of_column(table, stamped[0], None)} if len(stamped) == 1 else {}
    plan.found |= added
    if added:
        shown = ", ".join(
            f"{' + '.join(map(repr, recipe.weights))} for {name} in "
            f"{recipe.unit or SI_UNITS[name][0]}"
            for name, recipe in added.items()
        )
        plan.warnings.append(
            f"{table.file}: by its name was taken {shown}: check it, or say in a column map what "
            f"the columns are"
        )
    if commands:
        plan.warnings.append(
            f"{table.file}: {quoted(commands)} is a command, and not a measurement: log "
            f"the measured torque or current, which may be later and smaller"
        )


def _stamp_of_two(table: Table) -> Recipe | None:
    """A stamp's columns of whole seconds and of nanoseconds, as ROS writes it."""
    bare = {split_header(header)[0].lower(): header for header in table.names}
    parts = {header: match for name, header in bare.items() if (match := _NANOSECONDS.match(name))}
    found = [
        recipe_of_column(table, bare[match[1] + match[2]], "s", header)
        for header, match in parts.items()
        if match[1] + match[2] in bare
    ]
    return found[0] if len(found) == 1 else None


def _has_stamps(table: Table, name: str) -> bool:
    """Whether a column begins with a date and a time."""
    column = table.frame[name]
    if column.dtype.is_temporal():
        return True
    first = column.drop_nulls().head(1).to_list()
    return bool(first) and isinstance(first[0], str) and is_stamp(first[0].strip())


_Candidates = dict[str, list[tuple[Recipe, Usual]]]


def _candidates(table: Table, plan: _Plan, others: Iterable[str]) -> _Candidates:
    """Columns by the channel that their usual names stand for, of one joint, but for some."""
    taken = {*others, *(column.header for column in plan.found.values())}
    names = {header: table.short_name(header) for header in table.names if header not in taken}
    ignored = common_words(names.values())
    named = {header: named_channel(name, ignored) for header, name in names.items()}
    usual = {header: one for header, one in named.items() if one is not None}
    joint = _joint_of(table, usual, set(plan.found))
    found: _Candidates = {}
    for header, one in usual.items():
        if one.joint in ("", joint):
            found.setdefault(one.channel, []).append(
                (recipe_of_column(table, header, one.unit), one)
            )
    found = {name: _best(columns) for name, columns in found.items()}
    measured = [n for n in INPUTS if n in found and _is_plain(*found[n][0])]
    if measured:
        found = {n: columns for n, columns in found.items() if n in measured or n not in INPUTS}
    known = set(plan.found) | set(found)
    if not known & {"motor_position", "link_position", "deflection"}:  # a drive with one encoder
        for quantity in ("position", "velocity", "torque"):
            if f"motor_{quantity}" not in known and quantity in found:
                found[f"motor_{quantity}"] = found[quantity]
    elif not known & {"link_position", "deflection"} and len(found.get("position", ())) == 1:
        found["link_position"] = found["position"]  # what is not the motor's, as q beside theta_m
    return found


def _best(columns: list[tuple[Recipe, Usual]]) -> list[tuple[Recipe, Usual]]:
    """Of several columns those with a measured value in a unit that needs no scale."""
    return [one for one in columns if _is_plain(*one)] or columns


def _is_plain(column: Recipe, usual: Usual) -> bool:
    return not usual.is_command and not is_relative(column.unit or "")


def _joint_of(table: Table, usual: Mapping[str, Usual], given: set[str]) -> str:
    """The number of the only joint whose positions have one, or none; raise where several have."""
    motors_last = sorted(usual.items(), key=lambda item: item[1].channel == "motor_position")
    positions = {one.joint: h for h, one in motors_last if one.channel.endswith("position")}
    if "" in positions or len(positions) <= 1:
        return next((joint for joint in positions if joint), "")
    if "motor_position" in given:  # which of them is its link, no name says
        return ""
    numbers = sorted(positions, key=int)
    raise RecordingError(
        table.file,
        table.header,
        f"there are positions with the numbers {', '.join(numbers)}, of several joints or of the "
        f"two sides of one; found {table.listing}: name one joint's columns in a column map, as "
        f"motor_position = {positions[numbers[0]]!r}",
    )


def _require(table: Table, plan: _Plan) -> None:
    """Raise unless there are time, motor position, and link position or input; warn of either."""
    choices = {
        "time": ("time",),
        "motor_position": ("motor_position",),
        _LINK: ("link_position", "deflection"),
        _INPUT: INPUTS,
    }
    missing = [label for label, names in choices.items() if not plan.available & set(names)]
    if not missing:
        return
    taken = {term.column for e in plan.column_map.entries.values() for term in e.terms}
    taken |= {recipe.header for recipe in plan.found.values()}
    taken = {split_header(header)[0] for header in taken}
    bare = [name for name, _ in map(split_header, table.names) if name not in taken]
    hints = [did_you_mean(label.split(" ")[0], bare) for label in missing]
    labels = ", no ".join(label + hint for label, hint in zip(missing, hints, strict=True))
    what = "a column map" if plan.column_map is _NO_MAP else plan.column_map.described
    if (
        len(missing) == 1
        and plan.column_map.unread & set(choices[missing[0]])
        and missing[0] in _OPTIONAL
    ):
        return  # as the map says
    if missing == [_INPUT]:
        likely = [
            header
            for header in table.names
            if split_header(header)[0] in bare and may_be_input(header)
        ]
        if hints[0] or likely:
            which = quoted(likely) if likely else "that column"
            found = [named_channel(header) for header in likely]
            if any(one is not None and one.channel == "torque" for one in found):
                what += ", unless a sensor measures it at the spring"
            plan.warnings.append(
                f"{table.file}: there is no {labels}, so only the link can be identified: to "
                f"identify the motor too, name {which} in {what}"
            )
        return
    if missing != [_LINK]:
        remedy = f"rename the columns or say in {what} which is which"
        if missing == ["time"]:
            remedy += "; for rows without a time, write sample_time = 0.001 for 1 ms there"
        of_rows = _names_of_rows(table)
        if of_rows:
            remedy = f"{of_rows!r} says what each row holds: export a row for each sample instead"
        raise RecordingError(
            table.file, table.header, f"there is no {labels}; found {table.listing}: {remedy}"
        )
    plan.warnings.append(
        f"{table.file}: there is no {labels}, so only the rigid joint can be identified: to "
        f"identify the compliance, log it or name its column in {what}; found "
        f"{table.listing}"
    )


def _names_of_rows(table: Table) -> str:
    """A column whose cells are names of channels; empty if there is none."""
    import polars as pl

    for column in table.frame.head(_MOST_CHANNELS):
        cells = column.unique().drop_nulls().to_list() if column.dtype == pl.String else []
        if sum(named_channel(cell) is not None for cell in cells) > 1:
            return column.name
    return ""


def _wanted(table: Table, plan: _Plan) -> set[str]:
    """The channels to read: of several inputs, and of two link positions, only one."""
    wanted = plan.available
    first, *others = [name for name in INPUTS if name in wanted] or [""]
    left_out = dict.fromkeys(others, f"{first} is there: remove {first} to use it")
    if {"link_position", "deflection"} <= wanted:
        why = "the link position is there: remove the link position to use it"
        left_out = {"deflection": why, **left_out}
    if "link_velocity" in wanted and not wanted & {"link_position", "deflection"}:
        left_out = {"link_velocity": "there is no link position: log it", **left_out}
    for name, why in left_out.items():
        plan.warnings.append(f"{table.file}: {name} is not used, since {why}")
    return wanted - {*left_out}
