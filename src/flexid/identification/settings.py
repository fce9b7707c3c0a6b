"""Settings of an identification, and what the user already knows."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import isfinite
from typing import Literal

from flexid.errors import SettingError
from flexid.models.flexible_joint import COEFFICIENT_UNITS, PAPER_TERMS, TERMS
from flexid.recording.recording import Hold

_LARGEST_SHARE = 0.8


@dataclass(frozen=True)
class Settings:
    """Choices of an identification; the defaults do the right thing for a log of torque.

    Parameters
    ----------
    terms : tuple of str, optional
        Terms of the flexible joint; see `flexid.models.flexible_joint.TERMS`.
    known : mapping of str to float, optional
        ``motor_inertia`` in kg m² (with a torque input), or coefficients by name.
    hold : {"auto", "zero", "linear"}, optional
        How the input behaves between samples; ``auto`` takes what fits the log better.
    filter_rate : float, optional
        Rate of the state-variable filter in 1/s; chosen from the log if not given.
    validation_share : float, optional
        Share of each piece, at its end, that the free run is tested on.

    Raises
    ------
    SettingError
        If a value cannot be used.
    """

    terms: tuple[str, ...] = PAPER_TERMS
    known: Mapping[str, float] = field(default_factory=dict)
    hold: Hold | Literal["auto"] = "auto"
    filter_rate: float | None = None
    validation_share: float = 1 / 3

    def __post_init__(self) -> None:
        for term in self.terms:
            if term not in TERMS:
                raise SettingError("terms", f"{term!r} is unknown; known are {', '.join(TERMS)}")
        for name, value in self.known.items():
            _check_known(name, value)
        if {"motor_inertia", "beta1"} <= set(self.known):
            raise SettingError("known", "motor_inertia and beta1 fix the same: give one of them")
        if self.hold not in ("auto", "zero", "linear"):
            raise SettingError("hold", f"{self.hold!r} is none of auto, zero, linear")
        if self.filter_rate is not None and not 0 < self.filter_rate < float("inf"):
            raise SettingError("filter-rate", "give a positive rate in 1/s")
        if not 0 < self.validation_share <= _LARGEST_SHARE:
            raise SettingError(
                "validation-share", f"give a share of the log between 0 and {_LARGEST_SHARE}"
            )

    def known_coefficients(self, input_is_torque: bool) -> dict[str, float]:
        """Coefficients whose value follows from what is known.

        Raises
        ------
        SettingError
            If a motor inertia is given with an input that is no torque.
        """
        known = dict(self.known)
        inertia = known.pop("motor_inertia", None)
        if inertia is None:
            return known
        if not input_is_torque:
            raise SettingError(
                "known",
                "motor_inertia fixes beta1 only when the input is a torque; this log's input is a "
                "voltage or current, whose gain is unknown too: leave it out",
            )
        return {**known, "beta1": 1 / inertia}


def _check_known(name: str, value: float) -> None:
    if name != "motor_inertia" and name not in COEFFICIENT_UNITS:
        raise SettingError(
            "known",
            f"{name!r} is unknown; give motor_inertia or a coefficient: "
            f"{', '.join(COEFFICIENT_UNITS)}",
        )
    inverted = name in ("motor_inertia", "beta1")  # each is the other's inverse
    usable = isfinite(value) and not (inverted and (value == 0 or not isfinite(1 / value)))
    if not usable or (name == "motor_inertia" and value < 0):
        raise SettingError("known", f"{name} = {value:g} is no possible value")
