"""Options of an identification, from what a user of Python writes to `Settings`."""

import math
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict

from flexid.errors import ArgumentError, SettingError
from flexid.library.entrance import kind_of
from flexid.models.arm_name import is_arm_file

if TYPE_CHECKING:
    from flexid.identification.preparation.joint import Kind
    from flexid.identification.preparation.settings import Settings
    from flexid.recording.recording import Hold

    Known: TypeAlias = Mapping[str, float | tuple[float, float]]
    """Values by name, alone or with their standard deviation."""

    Bounds: TypeAlias = Mapping[str, tuple[float | None, float | None]]
    """Lower and upper end by name; None where there is none."""

    Terms: TypeAlias = str | Iterable[str]
    """Names of terms, or "auto"."""

    AutoModel: TypeAlias = Kind | Literal["auto"]
    """Model of the joint, or "auto"."""

    AutoHold: TypeAlias = Hold | Literal["auto"]
    """How the input behaves between samples, or "auto"."""

    AutoNumber: TypeAlias = float | Literal["auto"]
    """A number, or "auto"."""

    class JointOptions(TypedDict, total=False):
        """Options of an identification, as `flexid.identify` takes them."""

        known: Known | None
        bounds: Bounds | None
        model: AutoModel
        terms: Terms
        hold: AutoHold
        input_delay: AutoNumber
        link_delay: AutoNumber
        coulomb_velocity: AutoNumber
        filter_rate: AutoNumber
        segment_duration: AutoNumber
        validation_share: float


def joint_settings(function: str, *, known: Any = None, **options: Any) -> "Settings":
    """Settings of an identification; what is not given is as usual."""
    from flexid.identification.preparation.settings import Settings

    values, deviations = as_known(function, known)
    chosen = {
        name: _CONVERSIONS.get(name, _auto_number)(function, name, value)
        for name, value in options.items()
    }
    return Settings(known=values, known_deviations=deviations, **chosen)


def _name(function: str, argument: str, value: Any) -> str:
    """A name, which `Settings` checks."""
    if not isinstance(value, str):
        example = "link" if argument == "model" else "zero"
        said = f"is {kind_of(value)}: give a name such as {example!r}"
        raise ArgumentError(function, argument, said)
    if argument == "model" and is_arm_file(value):
        raise SettingError(
            "model", f"{value!r} is an arm: only flexid identify, the command, takes it"
        )
    return value


def as_number(function: str, argument: str, value: Any) -> float:
    """A real number, if it is one; else an `ArgumentError`."""
    if not isinstance(value, Real) or isinstance(value, bool):
        raise ArgumentError(function, argument, f"is {kind_of(value)}: give a number")
    return float(value)


def as_mapping(function: str, argument: str, value: Any, example: str) -> Mapping[str, Any]:
    """A mapping by names, empty for None; else an `ArgumentError`."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise ArgumentError(
            function, argument, f"is {kind_of(value)}: give a mapping such as {example}"
        )
    for name in value:
        if not isinstance(name, str):
            raise ArgumentError(
                function, argument, f"has the key {name!r}: give names, as in {example}"
            )
    return value


def _auto_number(function: str, argument: str, value: Any) -> Any:
    if isinstance(value, str):
        if value == "auto":
            return value
        raise ArgumentError(function, argument, f"is {value!r}: give a number, or 'auto'")
    return as_number(function, argument, value)


def _terms(function: str, _argument: str, terms: Any) -> Any:
    return terms if isinstance(terms, str) and terms == "auto" else as_names(function, terms)


def as_names(function: str, terms: Any) -> tuple[str, ...]:
    """Names, each once, that stand between commas or one by one."""
    if isinstance(terms, str):
        return tuple(dict.fromkeys(name.strip() for name in terms.split(",") if name.strip()))
    names = tuple(terms) if isinstance(terms, Iterable) else (terms,)
    wrong = [name for name in names if not isinstance(name, str)]
    if wrong:
        said = f"holds {kind_of(wrong[0])}: give names, such as ['gravity'], or 'auto'"
        raise ArgumentError(function, "terms", said)
    return tuple(dict.fromkeys(names))


def as_known(function: str, known: Any) -> tuple[dict[str, float], dict[str, float]]:
    """Values by name, and the standard deviations of those that have one."""
    example = "{'motor_inertia': 0.3} or {'motor_inertia': (0.3, 0.01)}"
    values: dict[str, float] = {}
    deviations: dict[str, float] = {}
    for name, value in as_mapping(function, "known", known, example).items():
        pair = (value.nominal_value, value.std_dev) if hasattr(value, "nominal_value") else value
        if not isinstance(pair, list | tuple):
            pair = (pair,)
        if len(pair) not in (1, 2):
            raise ArgumentError(
                function, f"known[{name!r}]", "is neither a value nor (value, standard deviation)"
            )
        numbers = [as_number(function, f"known[{name!r}]", number) for number in pair]
        values[name] = numbers[0]
        if len(numbers) == 2:
            deviations[name] = numbers[1]
    return values, deviations


def _bounds(function: str, _argument: str, bounds: Any) -> dict[str, tuple[float, float]]:
    example = "{'theta2': (50, 200), 'alpha2': (0, None)}"
    found = {}
    for name, ends in as_mapping(function, "bounds", bounds, example).items():
        if not isinstance(ends, list | tuple) or len(ends) != 2:
            raise ArgumentError(
                function, f"bounds[{name!r}]", "is no pair (lower, upper): None where there is none"
            )
        lower, upper = (
            infinite if end is None else as_number(function, f"bounds[{name!r}]", end)
            for end, infinite in zip(ends, (-math.inf, math.inf), strict=True)
        )
        found[name] = (lower, upper)
    return found


_CONVERSIONS = {
    "model": _name,
    "hold": _name,
    "terms": _terms,
    "bounds": _bounds,
    "validation_share": as_number,
}
"""Of the options that are no number or "auto"."""
