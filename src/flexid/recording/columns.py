"""Assignment of the columns of a file to channels, by their names or by a column map."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from flexid.errors import RecordingError
from flexid.recording.names import (
    Usual,
    common_words,
    folded,
    is_setpoint,
    may_be_channel,
    named_channel,
    nearest_name,
    quoted,
    split_header,
    words_of,
)
from flexid.recording.recipes import (
    ARGUMENT,
    NO_GEAR,
    ColumnMap,
    MapSource,
    Recipe,
    joint_of,
    make_channel,
    read_map,
    recipe_of_column,
)
from flexid.recording.recording import (
    INPUTS,
    POSITIONS,
    SI_UNITS,
    VELOCITIES,
    Channel,
    si_units,
)
from flexid.recording.sides import drop_copies, likely_deflection, name_sides, several, stated_guess
from flexid.recording.table import Clock, Table, is_stamp
from flexid.recording.units import is_relative

if TYPE_CHECKING:
    import polars

_LINK = "link_position (or deflection)"
_INPUT = "motor_torque (or motor_current, or motor_voltage)"
_NEEDED = {
    "time": ("time",),
    "motor_position": ("motor_position", "motor_velocity"),
    _LINK: ("link_position", "deflection", "link_velocity"),
    _INPUT: INPUTS,
}
_BY_FOLDED = {name.replace("_", ""): name for name in SI_UNITS}
_UNNAMED = re.compile(r"(?i)unnamed\b")  # name that flexid and pandas give to unnamed columns
_NO_MAP = ColumnMap("", {}, None, frozenset())


def read_channels(
    table: Table, columns: MapSource | None
) -> tuple[dict[str, Channel], tuple[str, ...]]:
    """Return the channels of a table in SI units, by canonical name, and warnings."""
    recipes, warnings = recipes_of(table, columns)
    return channels_of(table, recipes, Clock()), warnings


def channels_of(table: Table, recipes: Mapping[str, Recipe], clock: Clock) -> dict[str, Channel]:
    """Return the channels that recipes make of a table, or of a part of one."""
    return {name: make_channel(table, name, recipe, clock) for name, recipe in recipes.items()}


def recipes_of(
    table: Table, columns: MapSource | None
) -> tuple[dict[str, Recipe], tuple[str, ...]]:
    """Return the recipe of each channel that is read, and warnings."""
    plan = _Plan(table, columns)
    recipes = plan.wanted()
    plan.name_unused()
    return recipes, tuple(f"{table.file}: {warning}" for warning in plan.warnings)


class _Plan:
    """Source of each channel: a column map, or a column with a known name."""

    def __init__(self, table: Table, columns: MapSource | None) -> None:
        self.table = table
        self.warnings: list[str] = []
        self.map = _NO_MAP if columns is None else read_map(columns)
        # An entry for a clamped side names no column.
        self.is_mapped = bool(self.map.recipes.keys() - self.map.clamped or self.map.unread)
        self.mapped = {name: self.map.recipe(table, name) for name in self.map.recipes}
        self.found: dict[str, Recipe] = {}  # recipes of channels that were found by name
        self.guessed: list[str] = []  # channels of sides that no name states
        self._add_canonical()
        self._add_usual()
        self.available = {*self.found, *self.map.recipes}
        self._require()

    def wanted(self) -> dict[str, Recipe]:
        """Recipes of the channels to read, with one input and one link position."""
        wanted = self.available
        first, *others = [name for name in INPUTS if name in wanted] or [""]
        left_out = dict.fromkeys(others, f"there is a {first}: remove {first} to use it")
        if {"link_position", "deflection"} <= wanted:
            why = "there is a link position: remove the link position to use it"
            left_out = {"deflection": why, **left_out}
        for name in VELOCITIES:
            if name in wanted and name.replace("velocity", "position") in self.map.clamped:
                left_out[name] = "that side is clamped: remove it"
        self.warnings += [f"{name} is not used, since {why}" for name, why in left_out.items()]
        recipes = {
            name: self.mapped[name]
            if name in self.mapped
            else self.found[name]._replace(ratio=self.map.ratio)
            for name in SI_UNITS
            if name in wanted - {*left_out}
        }
        joint = self.map.joint or joint_of(recipes.values())
        if joint == "prismatic" and self.map.joint is None and self.map.ratio is not None:
            raise RecordingError(self.map.file, "key 'gear_ratio'", NO_GEAR)
        return {name: recipe._replace(joint=joint) for name, recipe in recipes.items()}

    def name_unused(self) -> None:
        """Warn of unused columns, except in formats such as bags, with many unrelated signals."""
        taken = {header for recipe in self.found.values() for header in recipe.weights}
        # An unnamed column numbers the rows, or follows from a trailing separator.
        unused = [n for n in self.table.names if n not in taken and not _UNNAMED.match(n)]
        if self.is_mapped or self.table.kinds:
            return
        is_whole = all(self.available & {*_NEEDED[side]} for side in (_LINK, _INPUT))
        spare = [n for n in unused if not is_whole or may_be_channel(n)]
        if spare:
            it = "it" if len(spare) == 1 else "them"
            advice = f": if needed, assign {it} in a column map"
            self.warnings.append(f"{_not_used(spare)}{advice}")
        if len(spare) < len(unused):
            self.warnings.append(_not_used([n for n in unused if n not in spare]))

    def _refusal(self, reason: str) -> RecordingError:
        return RecordingError(self.table.file, self.table.header, reason)

    def _add_canonical(self) -> None:
        """Add columns with canonical names, except for channels and columns of a column map."""
        # A column that is a part of a sum may still be a channel of its own.
        named = {*self.map.recipes, *self.map.unread}
        for header in self._unmapped():
            bare, unit = split_header(self.table.short_name(header))
            name = _BY_FOLDED.get(folded(bare).replace("_", ""))
            if name is None or name in named:
                continue
            if name in self.found:
                raise self._refusal(
                    f"the columns {self.found[name].header!r} and {header!r} are both {name}: "
                    f"rename or remove one of them"
                )
            self.found[name] = recipe_of_column(self.table, header, unit)

    def _unmapped(self) -> list[str]:
        """Columns that are not a mapped channel by themselves."""
        mapped = {one.header for one in self.mapped.values() if len(one.weights) == 1}
        return [header for header in self.table.names if header not in mapped]

    def _skipped(self) -> set[str]:
        """Channels for which no column with a common name is sought.

        If a map names columns, only channels without which the log is refused, or used in part,
        are sought. If it names both positions, an input that it omits is meant to be left out.
        """
        skipped = {*self.found, *self.map.recipes, *self.map.unread}
        if all(self.map.recipes.keys() & {*_NEEDED[side]} for side in ("motor_position", _LINK)):
            skipped |= {*INPUTS}
        if "deflection" in skipped:
            skipped.add("link_position")
        for names in _NEEDED.values():
            if (self.is_mapped or names == INPUTS) and skipped & {*names} - {*VELOCITIES}:
                skipped |= {*names}
        return skipped

    def _add_usual(self) -> None:
        """Add columns with common names for channels without a column of the canonical name."""
        skipped = self._skipped()
        if skipped >= {*SI_UNITS}:
            return
        candidates = self._candidates()
        added: dict[str, Recipe] = {}
        for name in SI_UNITS:
            # A log whose map leaves out the link may have one encoder.
            is_doubtful = self.is_mapped and name in self.guessed and name.startswith("link")
            columns = [] if name in skipped or is_doubtful else candidates.get(name, [])
            columns = self._one_time(columns) if name == "time" else columns
            if len(columns) > 1 and not self.is_mapped:
                headers = [column.header for column in columns]
                raise self._refusal(several(name, headers, is_guess=name in self.guessed))
            if len(columns) == 1:
                added[name] = columns[0]
        if "time" not in {*skipped, *added}:
            stamped = [name for name in self.table.names if _has_stamps(self.table.frame[name])]
            if len(stamped) == 1:
                added["time"] = recipe_of_column(self.table, stamped[0], None)
        if not added:
            return
        self.found |= added
        joint = self.map.joint or joint_of([*self.found.values(), *self.mapped.values()])
        shown = ", ".join(
            f"{' + '.join(map(repr, recipe.weights))} for {name} in "
            f"{recipe.unit or si_units(name, joint)[0]}"
            for name, recipe in added.items()
        )
        guess = stated_guess(self.guessed, added, {*self.found, *self.mapped})
        self.warnings.append(
            f"taken by name: {shown}; {guess}check it, or define the columns in a column map"
        )

    def _one_time(self, columns: list[Recipe]) -> list[Recipe]:
        """Return columns other than stamps, or one recipe for a stamp as ROS divides it."""
        # It has whole seconds, and the nanoseconds beyond them.
        named = [(one, words_of(split_header(one.header)[0])) for one in columns]
        columns = [one for one, words in named if words and "stamp" not in words.all] or columns
        by_unit = {one.unit: one for one in columns}
        if len(columns) != 2 or by_unit.keys() != {"s", "ns"}:
            return columns
        whole, beyond = (self.table.numbers(by_unit[unit].header) for unit in ("s", "ns"))
        if np.any(whole % 1.0) or not np.all((beyond >= 0.0) & (beyond < 1e9)):
            return columns
        weights = {by_unit["s"].header: 1.0, by_unit["ns"].header: 1e-9}
        return [by_unit["s"]._replace(weights=weights)]

    def _candidates(self) -> dict[str, list[Recipe]]:
        """Columns of one joint, by the channel that their common names indicate."""
        taken = {one.header for one in self.found.values()}
        short = {h: self.table.short_name(h) for h in self._unmapped() if h not in taken}
        ignored = common_words(short.values())
        usual = {h: one for h, name in short.items() if (one := named_channel(name, ignored))}
        joints = {"", *(self._mapped_numbers() or [self._joint_of(usual)])}
        measured: dict[str, list[Recipe]] = {}
        filtered: dict[str, list[Recipe]] = {}
        commanded: dict[str, list[Recipe]] = {}
        for header, one in usual.items():
            if one.joint in joints:
                recipe = recipe_of_column(self.table, header, one.unit)
                kind = (measured, filtered, commanded)[one.precedence]
                kind.setdefault(one.channel, []).append(recipe)
        drives = {*INPUTS, "force"}
        given = {*self.found, *self.map.recipes} - self.map.clamped
        drop_copies(filtered, {*given, *measured})
        found = {name: own for name, own in filtered.items() if name not in drives} | measured
        # Columns in absolute units take precedence over counts and percentages.
        plain = {
            name: [one for one in own if not is_relative(one.unit or "")]
            for name, own in found.items()
        }
        found = {name: plain[name] or own for name, own in found.items()}
        if any(plain.get(name) for name in INPUTS):
            found = {n: own for n, own in found.items() if n not in INPUTS or plain[n]}
        self.guessed = name_sides(found, given)
        known = {*given, *found}
        places = [recipe for name, own in found.items() if "position" in name for recipe in own]
        assigned = {**self.found, **self.mapped}
        places += [recipe for name, recipe in assigned.items() if name in POSITIONS]
        # In a log with angles or a current, a force may belong to something else.
        moves = joint_of(places, "revolute" if known & {*INPUTS} else "prismatic")
        if "force" in found and moves == "prismatic" and "motor_torque" not in self.found:
            found.setdefault("motor_torque", found["force"])
        # A filtered input is used only if no other was measured, a command if none was.
        for other in (filtered, commanded):
            if {*INPUTS}.isdisjoint({*self.found, *found}):
                force = {"motor_torque": other["force"]} if "force" in other else {}
                own = {name: one for name, one in other.items() if name in drives}
                found |= {**force, **own} if moves == "prismatic" else own
        return found

    def _mapped_numbers(self) -> list[str]:
        """Numbers in the name of a mapped motor position; one of them may be its joint's."""
        motor = self.mapped.get("motor_position")
        headers = [] if motor is None else [*motor.weights]
        return [n for header in headers for n in re.findall(r"\d+", split_header(header)[0])]

    def _joint_of(self, usual: Mapping[str, Usual]) -> str:
        """Number of the joint in the names of positions, if any; raise if there are several."""
        motors_last = sorted(usual.items(), key=lambda item: item[1].channel == "motor_position")
        positions = {one.joint: h for h, one in motors_last if one.channel.endswith("position")}
        if "" in positions or len(positions) <= 1:
            return next((joint for joint in positions if joint), "")
        if "motor_position" in {*self.found, *self.mapped}:
            return ""  # names do not show which of them is its link
        numbers = sorted(positions, key=int)
        raise self._refusal(
            f"there are positions with the numbers {', '.join(numbers)}, of several joints or of "
            f"the two sides of one; found {self.table.listing}: name one joint's columns in a "
            f"column map, as motor_position = {positions[numbers[0]]!r}"
        )

    def _require(self) -> None:
        """Raise if time, motor position, or both link position and input lack; warn if one does."""
        recipes = (*self.found.values(), *self.map.recipes.values())
        taken = {split_header(column)[0] for recipe in recipes for column in recipe.weights}
        free = {h: name for h in self.table.names if (name := split_header(h)[0]) not in taken}
        bare = {header: name for header, name in free.items() if not is_setpoint(header)}
        missing = [
            label
            for label, names in _NEEDED.items()
            # A velocity replaces a position, unless a column seems to be a misspelt position.
            if (there := self.available & {*names}) <= {*VELOCITIES}
            and not (there and not nearest_name(names[0], bare.values()))
        ]
        is_optional = missing in ([_LINK], [_INPUT])
        is_meant = is_optional and self.map.unread & {*_NEEDED[missing[0]]}
        if not missing or is_meant or (missing == [_INPUT] and not free):
            return
        hints = [nearest_name(label.split(" ")[0], bare.values()) for label in missing]
        lacks = ", no ".join(label + hint for label, hint in zip(missing, hints, strict=True))
        what = "a column map"
        if self.is_mapped:
            what = ARGUMENT if self.map.file == ARGUMENT else f"the column map {self.map.file}"
        found = f"found {self.table.listing}"
        likely = next((f", as {name} = {header!r}" for name, header in _likely(missing, bare)), "")
        if _LINK in missing and (alpha := likely_deflection(bare, self.table.names)):
            likely = f", as deflection = {alpha!r} if it is the arm's angle relative to the motor"
        if is_optional:
            only = "rigid joint" if missing == [_LINK] else "link"
            self.warnings.append(
                f"there is no {lacks}, so only the {only} can be identified; {found}: log it, or "
                f"name its column in {what}{likely}"
            )
            return
        remedy = f"rename the columns or assign them in {what}{likely}"
        if missing == ["time"]:
            remedy += "; for rows without a time, write sample_time = 0.001 for 1 ms there"
        raise self._refusal(f"there is no {lacks}; {found}: {remedy}")


def _not_used(columns: Collection[str]) -> str:
    return f"{quoted(columns)} {'is' if len(columns) == 1 else 'are'} not used"


def _likely(missing: Iterable[str], columns: Collection[str]) -> Iterator[tuple[str, str]]:
    """Yield missing channels with columns whose names have a word for their quantity."""
    for label in missing:
        name = label.partition(" ")[0]
        for header in columns:
            words, kind = words_of(split_header(header)[0]), name.rpartition("_")[2]
            if words is None or kind not in words.quantities:
                continue
            # In "voltage q" the q denotes an axis, not a position. A filtered position without a
            # side may be the motor's.
            others = {"torque", "current", "voltage"} - {kind}
            others |= {"motor", "filtered"} if name == "link_position" else {"link"}
            if others.isdisjoint(words.kinds):
                yield name, header


def _has_stamps(column: polars.Series) -> bool:
    """Whether the first cell of a column is a time stamp, or all are dates or times."""
    first = next(iter(column.drop_nulls().head(1)), None)
    is_text = isinstance(first, str) and is_stamp(first.strip())
    return is_text or column.dtype.is_temporal()
