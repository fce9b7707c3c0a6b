"""What a window has chosen: read from its form or its address, never believed.

Form and address have the same keys, so that a link shows what the form showed::

    room=identify  hold=zero  terms=gravity,motor_viscous  gear_ratio=101
    column.motor_position=enc_2  unit.motor_position=deg  scale.motor_position=0.5
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from flexid.errors import SettingError
from flexid.models.flexible_joint import SHAPE_TERMS, TERMS
from flexid.models.rigid_joint import RIGID_TERMS
from flexid.recording.channel import SI_UNITS

LONGEST_VALUE = 300  # characters
MOST_KEYS = 80


def texts_of(values: object) -> dict[str, str]:
    """Texts by key, as many and as long as a form has; what is no text is left out."""
    if not isinstance(values, Mapping) or len(values) > MOST_KEYS:
        raise SettingError("address", "it holds what the studio does not know: open it without")
    texts = {}
    for key, value in values.items():
        if isinstance(key, str) and isinstance(value, str):
            if len(value) > LONGEST_VALUE:
                raise SettingError("address", f"a value has more than {LONGEST_VALUE} characters")
            texts[key] = value
    return texts


def one_of(what: str, text: str, known: Iterable[str]) -> str:
    """A text, if it is known; else a `SettingError`."""
    known = list(known)
    if text not in known:
        raise SettingError(what, f"{text[:40]!r} is none of {', '.join(known)}")
    return text


MODELS = ("auto", "flexible", "link", "rigid")
HOLDS = ("auto", "zero", "linear", "cubic")
ALL_TERMS = tuple(dict.fromkeys([*TERMS, *SHAPE_TERMS, *RIGID_TERMS]))


@dataclass(frozen=True)
class Source:
    """Where a channel comes from."""

    column: str  # a header of the file
    unit: str = ""  # its unit; empty for what the header says, or SI
    scale: float = 1.0  # in the unit
    offset: float = 0.0  # in the unit

    @property
    def stated(self) -> dict[str, Any]:
        """What differs from the column as it is, by name."""
        usual = Source("")
        stated = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: value for name, value in stated.items() if value != getattr(usual, name)}


@dataclass(frozen=True)
class Choices:
    """What a window has chosen."""

    sources: Mapping[str, Source] = field(default_factory=dict)
    gear_ratio: float | None = None
    model: str = "auto"
    hold: str = "auto"
    terms: tuple[str, ...] | None = None  # terms of the model; chosen from the log if None
    ran: bool = False  # whether it was run
    lead: float | None = None  # m in a turn of the motor

    @property
    def column_map(self) -> dict[str, Any] | None:
        """The choices as a column map; None where the names of the columns decide.

        A channel that was not chosen is not read, whatever names there are.
        """
        if not self.sources:
            return None
        entries: dict[str, Any] = dict.fromkeys(SI_UNITS, False)
        entries |= {channel: source.stated for channel, source in self.sources.items()}
        ratios = {"gear_ratio": self.gear_ratio, "lead": self.lead}
        return entries | {name: value for name, value in ratios.items() if value is not None}

    @property
    def settings(self) -> dict[str, Any]:
        """Keywords for `flexid.identify`."""
        return {
            "model": self.model,
            "hold": self.hold,
            "terms": "auto" if self.terms is None else self.terms,
        }


def read_choices(values: object) -> Choices:
    """Choices from what a form or an address holds.

    Keys that are not known are left out; so is ``log``, which some would like to be a path.
    """
    texts = texts_of(values)
    sources = {}
    for channel in SI_UNITS:
        column = texts.get(f"column.{channel}", "")
        if column:
            sources[channel] = Source(
                column,
                texts.get(f"unit.{channel}", ""),
                _number(f"scale of {channel}", texts.get(f"scale.{channel}", ""), 1.0),
                _number(f"offset of {channel}", texts.get(f"offset.{channel}", ""), 0.0),
            )
    return Choices(
        sources,
        _ratio("gear_ratio", texts) if sources else None,
        one_of("model", texts.get("model", "auto"), MODELS),
        one_of("hold", texts.get("hold", "auto"), HOLDS),
        _terms(texts["terms"]) if "terms" in texts else None,
        texts.get("ran") == "yes",
        _ratio("lead", texts) if sources else None,
    )


def _ratio(name: str, texts: Mapping[str, str]) -> float | None:
    text = texts.get(name)
    return _number(name.replace("_", " "), text, 1.0) if text else None


def _number(what: str, text: str, default: float) -> float:
    if not text.strip():
        return default
    above, fraction, below = text.partition("/")
    try:
        value = float(above) / (float(below) if fraction else 1.0)
    except (ValueError, ZeroDivisionError):
        value = math.nan
    if not math.isfinite(value):
        raise SettingError(
            what, f"{text[:40]!r} is no number: write one such as 0.5, 1/101 or -1.5e-3"
        )
    return value


def _terms(text: str) -> tuple[str, ...]:
    names = {one_of("terms", name, ALL_TERMS) for name in text.split(",") if name}
    return tuple(name for name in ALL_TERMS if name in names)  # however an address orders them
