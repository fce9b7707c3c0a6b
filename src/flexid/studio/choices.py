"""Choices of a window, read from its form or its address, which have the same keys.

``room=identify  hold=zero  terms=gravity,motor_viscous  unit.motor_position=deg``
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from flexid.errors import SettingError, one_of
from flexid.models.flexible_joint import RIGID_TERMS, SHAPE_TERMS, TERMS
from flexid.paper.loop import Multisine
from flexid.recording.recording import SI_UNITS
from flexid.studies import runs

if TYPE_CHECKING:
    from flexid.simulation.closed_loop import ClosedLoop
    from flexid.simulation.sampled import Sampling

LONGEST_VALUE = 300  # characters
MOST_KEYS = 80


def texts_of(values: object) -> dict[str, str]:
    """Return the texts by key, leaving other values out; raise if too many or too long."""
    if not isinstance(values, Mapping) or len(values) > MOST_KEYS:
        raise SettingError("address", "it has too many values: open the studio without them")
    texts = {}
    for key, value in values.items():
        if isinstance(key, str) and isinstance(value, str):
            if len(value) > LONGEST_VALUE:
                raise SettingError("address", f"a value has more than {LONGEST_VALUE} characters")
            texts[key] = value
    return texts


MODELS = ("auto", "flexible", "link", "rigid")
HOLDS = ("auto", "zero", "linear", "cubic")
ALL_TERMS = tuple(dict.fromkeys([*TERMS, *SHAPE_TERMS, *RIGID_TERMS]))


@dataclass(frozen=True)
class Source:
    """Column of a channel, with its unit, scale and offset."""

    column: str  # a header of the file
    unit: str = ""  # unit of the column; if empty, the header's unit, or else SI
    scale: float = 1.0  # factor from the column to the channel, both in the unit
    offset: float = 0.0  # in the unit

    @property
    def stated(self) -> dict[str, Any]:
        """Fields that differ from their defaults, and the column, by name."""
        usual = vars(Source(""))
        return {name: value for name, value in vars(self).items() if value != usual[name]}


@dataclass(frozen=True)
class Choices:
    """Choices of a window: columns and settings."""

    sources: Mapping[str, Source] = field(default_factory=dict)
    gear_ratio: float | None = None
    model: str = "auto"
    hold: str = "auto"
    terms: tuple[str, ...] | None = None  # terms of the model; chosen from the log if None
    ran: bool = False  # whether an identification was run
    lead: float | None = None  # m per turn of the motor

    @property
    def column_map(self) -> dict[str, Any] | None:
        """Choices as a column map; None if the names of the columns decide."""
        if not self.sources:
            return None
        ratios = {"gear_ratio": self.gear_ratio, "lead": self.lead}
        entries: dict[str, Any] = {n: value for n, value in ratios.items() if value is not None}
        entries |= dict.fromkeys(SI_UNITS, False)
        return entries | {channel: source.stated for channel, source in self.sources.items()}

    @property
    def settings(self) -> dict[str, Any]:
        """Keyword arguments for `flexid.identify`."""
        return {
            "model": self.model,
            "hold": self.hold,
            "terms": "auto" if self.terms is None else self.terms,
        }


def read_choices(values: object) -> Choices:
    """Read choices from a form or an address; unknown keys are ignored, and no key is a path."""
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
            what, f"{text[:40]!r} is not a number: write one such as 0.5, 1/101 or -1.5e-3"
        )
    return value


def _terms(text: str) -> tuple[str, ...]:
    names = {one_of("terms", name, ALL_TERMS) for name in text.split(",") if name}
    return tuple(name for name in ALL_TERMS if name in names)  # in a fixed order


READINGS = {runs.reading_name(exponents): runs.MEANINGS[exponents] for exponents in runs.SIMULATED}
"""Readings of the printed gains whose loop stays bounded, with their meanings."""


@dataclass(frozen=True)
class Slider:
    """Slider for one number of the closed loop."""

    name: str
    label: str
    unit: str
    group: str
    lowest: float
    highest: float
    start: float  # value in Table I of Huang (2003)
    logarithmic: bool = True


_PLANT, _GAINS, _REFERENCE, _DRIVE = "Plant", "Gains", "Reference", "Sampled drive"

SLIDERS = (
    Slider("joint_stiffness", "joint stiffness", "N m/rad", _PLANT, 20, 500, 100),
    Slider("link_inertia", "link inertia", "kg m²", _PLANT, 0.2, 5, 1),
    Slider("motor_inertia", "motor inertia", "kg m²", _PLANT, 0.05, 2, 0.3),
    Slider("gravity_torque", "gravity torque", "N m", _PLANT, 0, 20, 5, logarithmic=False),
    Slider("motor_viscous_friction", "motor friction", "N m s/rad", _PLANT, 0, 2, 0.1, False),
    Slider("k", "attenuation k", "1/s", _GAINS, 5, 200, runs.ATTENUATION),
    Slider("c", "observer gain c", "", _GAINS, 0.01, 100, runs.OBSERVER_GAIN),
    Slider("amplitude", "amplitude", "rad", _REFERENCE, 0.1, 10, runs.AMPLITUDE),
    Slider("frequency", "frequency", "rad/s", _REFERENCE, 0.5, 20, runs.FREQUENCY),
    Slider("sample_time", "sample time", "s", _DRIVE, 2e-4, 1e-2, 1e-3),
    Slider("noise", "encoder noise", "rad", _DRIVE, 1e-7, 1e-2, 1e-6),
    Slider("torque_limit", "torque limit", "N m", _DRIVE, 10, 1e6, 1e6),
)


@dataclass(frozen=True)
class PlayChoices:
    """Choices for a run of the closed loop."""

    reading: str  # powers of k in the three feedback gains: a key of `READINGS`
    sampled: bool
    numbers: tuple[float, ...]  # one per slider, in the order of `SLIDERS`

    @property
    def values(self) -> Mapping[str, float]:
        """Value of each slider, by its name."""
        return {slider.name: x for slider, x in zip(SLIDERS, self.numbers, strict=True)}

    @property
    def loop(self) -> ClosedLoop:
        """Closed loop of the paper with these values."""
        v = self.values
        a, b, c = map(int, self.reading.split(","))
        return runs.table1_loop(
            (a, b, c),
            v["k"],
            Multisine((v["amplitude"],), (v["frequency"],)),
            (v["c"], v["c"]),
            physical={name: v[name] for name in runs.PHYSICAL},
        )

    @property
    def sampling(self) -> Sampling | None:
        """Sampling, noise and torque limit; None if the drive is ideal."""
        from flexid.simulation.sampled import Sampling

        if not self.sampled:
            return None
        values = self.values
        return Sampling(
            values["sample_time"], values["torque_limit"], position_noise=values["noise"]
        )


TABLE1 = PlayChoices("1,2,3", False, tuple(slider.start for slider in SLIDERS))
"""Choices of Table I of Huang (2003)."""


def read_play(values: object, prefix: str = "") -> PlayChoices:
    """Read choices from a form or an address; missing values are those of Table I."""
    texts = texts_of(values)
    reading = one_of("reading", texts.get(f"{prefix}reading", "1,2,3"), READINGS)
    given = ((slider, texts.get(f"{prefix}{slider.name}")) for slider in SLIDERS)
    numbers = (slider.start if text is None else _within(slider, text) for slider, text in given)
    return PlayChoices(reading, texts.get(f"{prefix}sampled") == "yes", tuple(numbers))


def _within(slider: Slider, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not slider.lowest * (1 - 1e-9) <= value <= slider.highest * (1 + 1e-9):
        raise SettingError(
            slider.name, f"give a number from {slider.lowest:g} to {slider.highest:g} {slider.unit}"
        )
    return value
