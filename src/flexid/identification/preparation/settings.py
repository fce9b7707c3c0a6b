"""Settings of an identification, with the user's prior knowledge."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from math import isfinite, isnan
from typing import Literal

from flexid.errors import SettingError, check_names, one_of
from flexid.estimators.samples import FEWEST_SAMPLES
from flexid.estimators.state_variable_filter import check_filter_rate
from flexid.identification.preparation.joint import Joint, Kind
from flexid.models.flexible_joint import (
    COEFFICIENT_UNITS,
    POSITIVE,
    RIGID_TERMS,
    RIGID_UNITS,
    SHAPE_TERMS,
    TERMS,
)
from flexid.models.physical import PARAMETER_NAMES
from flexid.recording.checks import FASTEST_JOINT
from flexid.recording.recording import Hold

_LARGEST_SHARE = 0.8
_SLOWEST = 1e-6  # rad/s or m/s, least smoothing velocity of friction: half a turn in a month
_LARGEST_DELAY = 0.1  # of the shortest recording
_SMALLEST, _LARGEST = 1e-15, 1e15  # of any stated value, in SI units
_COEFFICIENTS = dict.fromkeys([*COEFFICIENT_UNITS, *RIGID_UNITS])
_FLEXIBLE = TERMS | SHAPE_TERMS
_TERMS = dict.fromkeys([*_FLEXIBLE, *RIGID_TERMS])
_NAMES = dict.fromkeys([*PARAMETER_NAMES, *_COEFFICIENTS])
_POSITIVE = POSITIVE | {"motor_inertia", "link_inertia", "inertia", "joint_stiffness"}

_DESCRIPTIONS: dict[Kind, str] = {
    "flexible": "the flexible joint (log with two encoders)",
    "link": "the link alone (log without an input)",
    "rigid": "the rigid joint (log with one encoder)",
}

Auto = Literal["auto"]


@dataclass(frozen=True)
class Settings:
    """Settings of an identification; ``auto`` means that the log decides."""

    # flexible: joint with both encoders and the input; link: link alone, driven by the measured
    # motor position, without the input; rigid: motor encoder and input. ``auto``: by the channels
    # of the log
    model: Kind | Auto = "auto"
    # names of terms: keys of `TERMS` and `SHAPE_TERMS` in `flexid.models.flexible_joint`; of
    # `RIGID_TERMS` there for a log with one encoder
    terms: tuple[str, ...] | Auto = "auto"
    # physical parameters, such as ``motor_inertia`` in kg m² or kg, or coefficients, by name
    known: Mapping[str, float] = field(default_factory=dict)
    # standard deviations of known values, by name; a value without one is exact
    known_deviations: Mapping[str, float] = field(default_factory=dict)
    # lower and upper bound of physical parameters or coefficients; infinite for no bound
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    hold: Hold | Auto = "auto"  # how the input behaves between samples
    # delay in s of the input: positive if it acts later than it was recorded
    input_delay: float | Auto = "auto"
    # delay in s of the link's encoder behind the motor's
    link_delay: float | Auto = "auto"
    # velocity in rad/s or m/s over which Coulomb friction changes sign; ``auto``: dry friction
    coulomb_velocity: float | Auto = "auto"
    # rate in 1/s of the state-variable filter of least squares, also used for streams
    filter_rate: float | Auto = "auto"
    segment_duration: float | Auto = "auto"  # length of the segments of the prediction error in s
    # share of each recording, at its end, held out for validation
    validation_share: float = 1 / 3

    def __post_init__(self) -> None:
        one_of("model", self.model, ("auto", *_DESCRIPTIONS))
        if self.terms != "auto":
            check_names("terms", self.terms, _TERMS)
        for name, value in self.known.items():
            _check_known(name, value, self.known_deviations.get(name, 0.0))
        for name, (lower, upper) in self.bounds.items():
            _check_bounds(name, lower, upper)
        one_of("hold", self.hold, ("auto", "zero", "linear", "cubic"))
        smooth = self.coulomb_velocity
        _check_positive("coulomb_velocity", smooth, "rad/s or m/s")
        if smooth != "auto" and not _SLOWEST <= smooth <= FASTEST_JOINT:
            raise SettingError(
                "coulomb_velocity",
                f"{smooth:g} is outside {_SLOWEST:g} to {FASTEST_JOINT:g} rad/s or m/s: give a "
                f"velocity within, or auto for dry friction",
            )
        _check_positive("filter_rate", self.filter_rate, "1/s")
        _check_positive("segment_duration", self.segment_duration, "s")
        for name in ("input_delay", "link_delay"):
            delay = getattr(self, name)
            if delay != "auto" and not isfinite(delay):
                raise SettingError(name, f"{delay} is no number of seconds: give one, or auto")
        if not 0 < self.validation_share <= _LARGEST_SHARE:
            raise SettingError(
                "validation_share",
                f"must lie above 0 and up to {_LARGEST_SHARE}, got {self.validation_share}",
            )

    @property
    def given_delay(self) -> float:
        """Largest given delay, in s; 0 if none is given."""
        given = (delay for delay in (self.input_delay, self.link_delay) if delay != "auto")
        return max(map(abs, given), default=0.0)


def check_for(joint: Joint, settings: Settings) -> None:
    """Raise `SettingError` for settings that the joint does not have."""
    what = _DESCRIPTIONS[joint.kind]
    if joint.type == "prismatic":
        what += ", which slides, with gravity as a part of the offsets"
    terms = joint.terms
    chosen = () if settings.terms == "auto" else settings.terms
    for term in chosen:
        if term not in terms:
            raise SettingError(
                "terms",
                f"{term!r} is no term of {what}; it has {', '.join(terms)}",
            )
    if joint.kind == "rigid" and "motor_inertia" in settings.known:
        raise SettingError(
            "known",
            "one encoder shows only the inertia of motor and link together, not motor_inertia: "
            "give beta1, the inverse of the whole inertia",
        )
    if joint.kind == "link":
        for setting in ("hold", "input_delay"):
            if getattr(settings, setting) != "auto":
                raise SettingError(
                    setting,
                    "the log has no input, so this setting has no meaning: leave it out",
                )


def check_against(
    settings: Settings,
    sample_time: float,  # in s
    shortest: float,  # in s
) -> None:
    """Raise `SettingError` for numbers that are impossible for a log."""
    length = settings.segment_duration
    if length != "auto" and length < FEWEST_SAMPLES * sample_time:
        raise SettingError(
            "segment_duration",
            f"{length:g} s is less than {FEWEST_SAMPLES} samples of this log: give "
            f"{FEWEST_SAMPLES * sample_time:.3g} s or more",
        )
    rate = settings.filter_rate
    if rate != "auto":
        check_filter_rate(rate, sample_time)
    for name in ("input_delay", "link_delay"):
        delay = getattr(settings, name)
        if delay != "auto" and abs(delay) > _LARGEST_DELAY * shortest:
            raise SettingError(
                name,
                f"{delay:g} s is more than a tenth of the log, {shortest:.4g} s: give seconds",
            )


def _check_positive(setting: str, value: float | str, unit: str) -> None:
    if isinstance(value, str):
        one_of(setting, value, ("auto",))
    elif not (isfinite(value) and value > 0):
        raise SettingError(setting, f"must be a positive number in {unit} or auto, got {value}")


def _check_known(name: str, value: float, deviation: float) -> None:
    _check_name("known", name)
    if not _possible(value) or (name in _POSITIVE and value <= 0.0):
        raise SettingError(
            "known",
            f"{name} = {value:g} is no possible value: give one in SI units"
            + (", above zero" if name in _POSITIVE else ""),
        )
    if not (_possible(deviation) and deviation >= 0):
        raise SettingError("known", f"{deviation:g} is no standard deviation of {name}")


def _check_bounds(name: str, lower: float, upper: float) -> None:
    _check_name("bounds", name)
    if isnan(lower) or isnan(upper) or lower >= upper:
        raise SettingError("bounds", f"of {name}: {lower:g} is not below {upper:g}")
    for end in (lower, upper):
        if isfinite(end) and not _possible(end):
            raise SettingError("bounds", f"of {name}: {end:g} is no possible value in SI units")
    if name in _POSITIVE and upper <= 0.0:
        raise SettingError("bounds", f"of {name}: the upper bound must be above 0, got {upper:g}")


def _check_name(setting: str, name: str) -> None:
    if name not in _NAMES:
        near = get_close_matches(name, _NAMES, 3) or ["motor_inertia", "joint_stiffness"]
        raise SettingError(
            setting,
            f"{name!r} is no parameter or coefficient of a joint; there are, for example, "
            f"{', '.join(near)}",
        )


def _possible(value: float) -> bool:
    """Whether a drive can have a value of this size, in any SI unit."""
    return isfinite(value) and (value == 0.0 or _SMALLEST <= abs(value) <= _LARGEST)
