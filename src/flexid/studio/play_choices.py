"""What the sliders of Play stand at: ranges, values from a form or an address, and the loop."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import urlencode

from flexid.control.laws import robust_law
from flexid.control.references import Multisine
from flexid.errors import SettingError
from flexid.models.flexible_joint import flexible_joint
from flexid.models.physical import joint_coefficients
from flexid.simulation.loop import ClosedLoop
from flexid.studies.huang2003.readings import MEANINGS, SIMULATED
from flexid.studies.huang2003.table1 import (
    AMPLITUDE,
    ATTENUATION,
    FREQUENCY,
    INITIAL_ESTIMATES,
    OBSERVER_GAIN,
    PHYSICAL,
    UNKNOWN,
)
from flexid.studio.choices import one_of, texts_of

if TYPE_CHECKING:
    from flexid.simulation.sampled import Sampling

READINGS = {",".join(map(str, exponents)): MEANINGS[exponents] for exponents in SIMULATED}
"""The readings of the printed gains whose loop stays bounded, and what they stand for."""


@dataclass(frozen=True)
class Slider:
    """A number that is played with."""

    name: str
    label: str
    unit: str
    group: str
    lowest: float
    highest: float
    start: float  # that of Table I of Huang (2003)
    logarithmic: bool = True


_PLANT, _GAINS, _REFERENCE, _DRIVE = "Plant", "Gains", "Reference", "Sampled drive"

SLIDERS = (
    Slider("joint_stiffness", "joint stiffness", "N m/rad", _PLANT, 20, 500, 100),
    Slider("link_inertia", "link inertia", "kg m²", _PLANT, 0.2, 5, 1),
    Slider("motor_inertia", "motor inertia", "kg m²", _PLANT, 0.05, 2, 0.3),
    Slider("gravity_torque", "gravity torque", "N m", _PLANT, 0, 20, 5, logarithmic=False),
    Slider("motor_viscous_friction", "motor friction", "N m s/rad", _PLANT, 0, 2, 0.1, False),
    Slider("k", "attenuation k", "1/s", _GAINS, 5, 200, ATTENUATION),
    Slider("c", "observer gain c", "", _GAINS, 0.01, 100, OBSERVER_GAIN),
    Slider("amplitude", "amplitude", "rad", _REFERENCE, 0.1, 10, AMPLITUDE),
    Slider("frequency", "frequency", "rad/s", _REFERENCE, 0.5, 20, FREQUENCY),
    Slider("sample_time", "sample time", "s", _DRIVE, 2e-4, 1e-2, 1e-3),
    Slider("noise", "encoder noise", "rad", _DRIVE, 1e-7, 1e-2, 1e-6),
    Slider("torque_limit", "torque limit", "N m", _DRIVE, 10, 1e6, 1e6),
)


@dataclass(frozen=True)
class PlayChoices:
    """What is played."""

    reading: str  # powers of k in the three feedback gains: a key of `READINGS`
    sampled: bool
    values: Mapping[str, float]  # by slider

    @property
    def pairs(self) -> dict[str, str]:
        """What differs from Table I, as an address holds it."""
        found = {} if self.reading == "1,2,3" else {"reading": self.reading}
        if self.sampled:
            found["sampled"] = "yes"
        for slider in SLIDERS:
            if self.values[slider.name] != slider.start:
                found[slider.name] = f"{self.values[slider.name]:.6g}"
        return found

    @property
    def loop(self) -> ClosedLoop:
        """The closed loop of the paper with these values."""
        values = self.values
        true = joint_coefficients({name: values[name] for name in PHYSICAL})
        a, b, c = map(int, self.reading.split(","))
        return ClosedLoop(
            flexible_joint(known={"beta1": true["beta1"]}),
            {name: true[name] for name in UNKNOWN},
            robust_law(values["k"], (a, b, c)),
            Multisine((values["amplitude"],), (values["frequency"],)),
            {"link": values["c"], "motor": values["c"]},
            INITIAL_ESTIMATES,
        )

    @property
    def sampling(self) -> Sampling | None:
        """How it is sampled; None where the drive is ideal."""
        from flexid.simulation.sampled import Sampling

        if not self.sampled:
            return None
        values = self.values
        return Sampling(
            values["sample_time"], values["torque_limit"], position_noise=values["noise"]
        )


TABLE1 = PlayChoices("1,2,3", False, {slider.name: slider.start for slider in SLIDERS})
"""Table I of Huang (2003)."""


def read_play(values: object, prefix: str = "") -> PlayChoices:
    """What a form or an address holds; what is not there is that of Table I."""
    texts = texts_of(values)
    reading = one_of("reading", texts.get(f"{prefix}reading", "1,2,3"), READINGS)
    found = {}
    for slider in SLIDERS:
        text = texts.get(f"{prefix}{slider.name}")
        found[slider.name] = slider.start if text is None else _within(slider, text)
    return PlayChoices(reading, texts.get(f"{prefix}sampled") == "yes", found)


def query_of(chosen: PlayChoices, pinned: PlayChoices | None) -> str:
    """The end of an address that shows a run, beside a pinned one."""
    pins = {} if pinned is None else {f"pin.{key}": text for key, text in pinned.pairs.items()}
    pin = "none" if pinned is None else "yes"
    return urlencode({"room": "play", **chosen.pairs, "pin": pin, **pins})


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
