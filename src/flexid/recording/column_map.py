"""Column maps: which raw columns make up a channel, and how."""

from __future__ import annotations

import re
from collections.abc import Mapping
from numbers import Real
from pathlib import Path
from typing import Annotated, Literal, TypeAlias

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from flexid.errors import RecordingError
from flexid.files import shown
from flexid.recording.channel import GEARED, LONGEST_SAMPLE_TIME, SHORTEST_SAMPLE_TIME, SI_UNITS
from flexid.recording.names import cut, did_you_mean
from flexid.recording.si_channels import ARGUMENT, ColumnMap
from flexid.toml_file import parse_toml, read_bytes

MapSource: TypeAlias = Path | Mapping[str, object]
"""A TOML file that holds a column map, or the same keys and values in Python."""

REMEDY = (
    "write a column name, a table of column or sum, scale, offset, unit and side, or false for a "
    "channel that is not to be read"
)
_RATIO = re.compile(r"\s*([+-]?\d+(?:\.\d+)?)\s*[/:]\s*(\d+(?:\.\d+)?)\s*")
_WANTED = "a column map in TOML"
_GEAR_REMEDY = 'write how often the motor turns in one turn of the link, as 101 or "1/101"'


def _quotient(value: object) -> object:
    """The number that a text such as "1/101" or one of NumPy's types stands for."""
    if isinstance(value, Real) and not isinstance(value, bool | int):
        return float(value)
    match = _RATIO.fullmatch(value) if isinstance(value, str) else None
    if match is None or not float(match[2]):
        return value
    return float(match[1]) / float(match[2])


Number = Annotated[float, BeforeValidator(_quotient), Field(allow_inf_nan=False)]


class Term(BaseModel):
    """One raw column with its factor."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    column: str  # with or without the unit in its header
    scale: Number = 1.0


class Entry(BaseModel):
    """``scale * (sum of the terms) + offset``, in `unit`."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    column: str | None = None  # the only raw column, or else `sum`
    sum: list[Term] = Field(default_factory=list)  # each by name, or with a factor of its own
    scale: Number = 1.0  # in `unit` per raw unit, perhaps a quotient such as "1/101"
    offset: Number = 0.0  # in `unit`
    unit: str | None = None  # None: as the header of the raw column says, or SI
    side: Literal["motor", "link"] | None = None  # of the gear; None: the motor's in a geared map

    @model_validator(mode="before")
    @classmethod
    def _names_as_terms(cls, value: object) -> object:
        if isinstance(value, str):
            return {"column": value}
        if not isinstance(value, Mapping):
            return value
        table = dict(value)
        if isinstance(table.get("sum"), list | tuple):
            table["sum"] = [
                {"column": term} if isinstance(term, str) else _plain(term) for term in table["sum"]
            ]
        return table

    @model_validator(mode="after")
    def _column_or_sum(self) -> Entry:
        if (self.column is None) == (not self.sum):
            raise ValueError("exactly one of 'column' and 'sum' is needed")
        return self

    @property
    def terms(self) -> list[Term]:
        """The raw columns with their factors."""
        return self.sum if self.column is None else [Term(column=self.column)]


def _plain(value: object) -> object:
    """A mapping of whatever type as a dictionary."""
    return dict(value) if isinstance(value, Mapping) else value


def read_map(source: MapSource) -> ColumnMap:
    """The column map in a TOML file, or in a mapping with its keys; a `false` channel is unread."""
    if isinstance(source, Mapping):
        return _map_of(ARGUMENT, dict(source))
    file = shown(source)

    def refuse(_key: str, reason: str) -> RecordingError:
        return RecordingError(file, "", reason)

    raw = read_bytes(source, _WANTED, refuse)
    return _map_of(file, parse_toml(raw, lambda _, reason: refuse("", _no_map(raw, reason))))


def _map_of(file: str, content: dict[str, object]) -> ColumnMap:
    """A column map from its keys and values."""
    if not content:
        raise RecordingError(file, "", "the column map is empty: name the columns in it")
    gear_ratio = _gear_ratio(file, content.pop("gear_ratio", None))
    sample_time = _sample_time(
        file, content.pop("sample_time", None), content.get("time", False) is not False
    )
    for key in content:
        if key not in SI_UNITS:
            raise RecordingError(
                file,
                f"key {key!r}",
                f"this is not a channel{did_you_mean(str(key), SI_UNITS)}: use one of "
                f"{', '.join(SI_UNITS)}, gear_ratio or sample_time",
            )
    unread = frozenset(key for key, value in content.items() if value is False)
    entries = {k: _entry(file, k, value) for k, value in content.items() if k not in unread}
    sided = [key for key, entry in entries.items() if entry.side is not None]
    for key in sided if gear_ratio is None else sorted({*sided} - {*GEARED}):
        what = "has a side, but the map no gear_ratio" if key in GEARED else "has no side"
        reason = f"{key} {what}: a side is for {', '.join(GEARED)} in a map with a gear_ratio"
        raise RecordingError(file, f"key '{key}.side'", reason)
    return ColumnMap(file, entries, gear_ratio, sample_time, unread)


def _no_map(raw: bytes, reason: str) -> str:
    """Why a file that is no TOML is no column map."""
    first = raw.lstrip().partition(b"\n")[0]
    if b"=" not in first and not first.startswith((b"#", b"[")):
        return (
            "this is not a column map, but perhaps the log: give --columns a TOML file such as "
            "examples/columns_voltage_arm.toml, and the log without an option"
        )
    return f"the column map {reason}"


def _gear_ratio(file: str, value: object) -> float | None:
    """Turns of the motor in one turn of the link, however the ratio is written."""
    if value is None:
        return None
    ratio = _quotient(value)
    if isinstance(value, str) and isinstance(ratio, float) and 0.0 < abs(ratio) < 1.0:
        ratio = 1.0 / ratio
    if isinstance(ratio, int | float) and not isinstance(ratio, bool) and 1.0 <= abs(ratio) <= 1e6:
        return float(ratio)
    reason = f"{cut(repr(value))} is not a ratio: {_GEAR_REMEDY}"
    raise RecordingError(file, "key 'gear_ratio'", reason)


def _sample_time(file: str, value: object, has_time: bool) -> float | None:
    """Seconds between the rows of a log without a time."""
    if value is None:
        return None
    place = "key 'sample_time'"
    if has_time:
        reason = "the map names a column for the time, too: leave one of the two out"
        raise RecordingError(file, place, reason)
    seconds = _quotient(value)
    if isinstance(seconds, bool) or not isinstance(seconds, int | float):
        reason = f'{value!r} is not a number of seconds: write it as 0.001 or "1/1000"'
        raise RecordingError(file, place, reason)
    if not SHORTEST_SAMPLE_TIME <= seconds <= LONGEST_SAMPLE_TIME:
        limits = f"{SHORTEST_SAMPLE_TIME:g} to {LONGEST_SAMPLE_TIME:g} s"
        reason = f"{cut(repr(value))} s is outside {limits}: write the seconds between two rows"
        raise RecordingError(file, place, reason)
    return float(seconds)


def _entry(file: str, key: str, value: object) -> Entry:
    """One entry of a column map; raise where the value is not what an entry may be."""
    try:
        return Entry.model_validate(value)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in (key, *first["loc"]))
        reason = {
            "extra_forbidden": "this key is not known",
            "model_type": "this is neither a column name nor a table",
        }.get(first["type"], first["msg"].removeprefix("Value error, "))
        raise RecordingError(file, f"key '{place}'", f"{reason}: {REMEDY}") from error
