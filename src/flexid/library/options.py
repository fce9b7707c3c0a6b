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


def joint_settings(
    function: str,
    *,
    known: Any = None,
    bounds: Any = None,
    model: Any = "auto",
    terms: Any = "auto",
    hold: Any = "auto",
    validation_share: Any = 1 / 3,
    **numbers: Any,
) -> "Settings":
    """Settings of an identification."""
    from flexid.identification.preparation.settings import Settings

    values, deviations = as_known(function, known)
    if isinstance(model, str) and is_arm_file(model):
        raise SettingError(
            "model", f"{model!r} is an arm: only flexid identify, the command, takes it"
        )
    if not isinstance(hold, str):
        raise ArgumentError(function, "hold", f"is {kind_of(hold)}: give a name such as 'zero'")
    if not isinstance(model, str):
        raise ArgumentError(function, "model", f"is {kind_of(model)}: give a name such as 'link'")
    return Settings(
        model=model,  # type: ignore[arg-type] - Settings checks it
        terms=as_terms(function, terms),
        known=values,
        known_deviations=deviations,
        bounds=_bounds(function, bounds),
        hold=hold,  # type: ignore[arg-type] - Settings checks it
        validation_share=as_number(function, "validation_share", validation_share),
        **{name: _auto_number(function, name, value) for name, value in numbers.items()},
    )


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


def as_terms(function: str, terms: Any) -> Any:
    """Names of terms as a tuple, or "auto"; an `ArgumentError` for what is neither."""
    return terms if terms == "auto" else as_names(function, terms)


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


def _bounds(function: str, bounds: Any) -> dict[str, tuple[float, float]]:
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
