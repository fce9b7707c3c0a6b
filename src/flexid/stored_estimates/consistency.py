"""What a stored estimate must be that its dataclasses do not say."""

from collections.abc import Iterator, Mapping
from math import isclose, isfinite

from pydantic import BaseModel, ConfigDict

from flexid.arms.result import ArmIdentification
from flexid.arms.unusual import link_delays
from flexid.estimators.channel_timing import INPUT
from flexid.identification.preparation.joint import joint_of
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate
from flexid.models.flexible_joint import RIPPLE_ORIGIN
from flexid.models.model_file import MOST_JOINTS
from flexid.models.planar_arm import planar_arm
from flexid.toml_file import Refuse


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)


class _Origin(_Part):
    columns: dict[str, float]
    factor: float
    offset: float
    unit: str
    gear_ratio: float | None


class _Log(_Part):
    file: str | None = None
    sha256: str | None = None
    columns: dict[str, _Origin] = {}


class _Asked(_Part):
    known: dict[str, float] = {}


class StoredProvenance(_Part):
    """Logs, and what was known; a part that nobody reads may be anything."""

    flexid_version: str = ""
    settings: _Asked = _Asked()
    inputs: list[_Log] = []


_LARGEST = 1e50  # of what a drive may be described by, in SI units
_LONGEST_DELAY = 10.0  # s
_ROUNDING = 1e-6  # relative difference of two numbers that are to be the same


def check_consistency(found: Identification | ArmIdentification, refuse: Refuse) -> None:
    """Refuse an estimate whose parts contradict each other, by the key that is wrong."""
    complaints = _complaints_of_arm(found) if found.model == "arm" else _complaints(found)
    for key, reason in complaints:
        raise refuse(key, f"is wrong, {reason}: correct it")


def _complaints(found: Identification) -> Iterator[tuple[str, str]]:
    yield from _of_the_fit(found)
    yield from _of_excitation(found)
    yield from _of_choices(found)
    for horizon, fits in found.validation.horizons.items():
        if {*fits} != {*found.validation.fit_percent}:
            yield f"validation.horizons.{horizon:g}", "it must name the channels of fit_percent"
    unknown = found.least_squares.keys() - found.coefficients.keys()
    if unknown:
        yield "least_squares", f"it names {min(unknown)!r}, which is no coefficient"
    yield from _of_parameters(found)


def _of_the_fit(found: Identification) -> Iterator[tuple[str, str]]:
    numbers = {}
    for kind in ("coefficients", "parameters", "removed"):
        numbers |= {f"{kind}.{n}.value": e.value for n, e in getattr(found, kind).items()}
    yield from _fit_complaints(found.fit, numbers)
    for kind in ("coefficients", "parameters"):  # what was removed was not fitted
        for name, value in getattr(found, kind).items():
            unknown = value.slopes.keys() - {*found.fit.names}
            if unknown:
                yield f"{kind}.{name}.slopes", f"it names {min(unknown)!r}, which was not fitted"


def _fit_complaints(fit: Estimate, numbers: Mapping[str, float]) -> Iterator[tuple[str, str]]:
    """What is wrong with the sizes of a fit, and with its values and other numbers by key."""
    count = len(fit.names)
    if not (
        fit.values.shape == (count,)
        and fit.covariance.shape == ((count, count) if count else (0,))
        and len(fit.degrees_of_freedom) == count
    ):
        yield "fit", f"values, freedom and covariance must have one entry for {count} names"
        return
    every = {**{f"fit.values.{name}": value for name, value in fit.by_name.items()}, **numbers}
    for key, value in every.items():
        if value and isfinite(value) and not 1.0 / _LARGEST < abs(value) < _LARGEST:
            yield key, f"{value:g} is no number that a drive has"


def _of_excitation(found: Identification) -> Iterator[tuple[str, str]]:
    if not found.excitation:
        yield "excitation", "it must have a row"
    for row, e in found.excitation.items():
        count = len(e.coefficients)
        if not (count and e.singular_values.shape == e.direction.shape == (count,)):
            yield (
                f"excitation.{row}",
                f"singular_values and direction must have one entry for {count} coefficients, and "
                f"there must be some",
            )
        if len(e.correlated) not in (0, 2):
            yield f"excitation.{row}.correlated", "it must name two coefficients, or none"


def _of_choices(found: Identification) -> Iterator[tuple[str, str]]:
    choices, alignment = found.choices, found.choices.alignment
    for name in ("input_delay", "link_delay"):
        delay = getattr(alignment, name).value
        if not abs(delay) <= _LONGEST_DELAY:
            yield f"choices.{name}.value", f"{delay:g} s is longer than {_LONGEST_DELAY:g} s"
    velocity = choices.coulomb_velocity
    if velocity is not None and not 0.0 < velocity < _LARGEST:
        yield "choices.coulomb_velocity", f"{velocity:g} is not positive"
    amplifier = choices.amplifier
    if not 0.0 <= amplifier.dead_zone < _LARGEST:
        yield "choices.amplifier.dead_zone", f"{amplifier.dead_zone:g} is negative or too large"
    if amplifier.limit is not None and not 0.0 < amplifier.limit < _LARGEST:
        yield "choices.amplifier.limit", f"{amplifier.limit:g} is not positive"
    for name, constant in choices.shapes.items():
        if not isfinite(constant) or (constant <= 0.0 and name != RIPPLE_ORIGIN):
            yield f"choices.shapes.{name}", f"{constant:g} is not positive"


def _of_parameters(found: Identification) -> Iterator[tuple[str, str]]:
    """Parameters that are not what their coefficients make them."""
    values = {name: c.value for name, c in found.coefficients.items() if isfinite(c.value)}
    for name, value in found.fit.by_name.items():
        if (
            name in values
            and isfinite(value)
            and not isclose(values[name], value, rel_tol=_ROUNDING)
        ):
            yield f"coefficients.{name}.value", f"{values[name]:g} is not the fit's {value:g}"
    gain = found.coefficients.get("beta1")
    joint = joint_of(found.model)
    is_torque = gain is None or gain.unit.endswith("/(N m)")
    for parameter in joint.parameters(values, input_is_torque=is_torque):
        made = found.parameters.get(parameter.name)
        if made is None or made.std == 0.0 or not isfinite(made.value):
            continue
        follows = parameter.value(values)
        if isfinite(follows) and not isclose(made.value, follows, rel_tol=_ROUNDING):
            yield (
                f"parameters.{parameter.name}.value",
                f"{made.value:g} is not {follows:g}, which follows from the coefficients",
            )


def _complaints_of_arm(found: ArmIdentification) -> Iterator[tuple[str, str]]:
    arm = found.arm
    if not 1 <= arm.joints <= MOST_JOINTS:
        yield "arm.lengths", f"an arm has 1 to {MOST_JOINTS} joints"
        return
    if not all(map(isfinite, (*arm.lengths, *arm.gravity))):
        yield "arm", "lengths and gravity must be numbers"
    if len(found.input_units) != arm.joints:
        yield "input_units", f"it must have one entry for each of {arm.joints} joints"
    values = {name: p.value for name, p in found.parameters.items()}
    yield from _fit_complaints(found.fit, {f"parameters.{n}.value": v for n, v in values.items()})
    known = {*planar_arm(arm).coefficients}
    there = {*found.fit.names, *found.fixed} - {INPUT, *link_delays(planar_arm(arm))}
    if there != known:
        yield "fit.names", f"with 'fixed' it must name {min(there ^ known)!r} as the arm does"
    for name, value in found.fit.by_name.items():
        if name in values and values[name] != value:
            yield f"parameters.{name}.value", f"{values[name]:g} is not the fit's {value:g}"
    for name in values.keys() - known:
        if not name.startswith("stiffness_over_inertia_"):
            yield f"parameters.{name}", "it is no parameter of this arm"
