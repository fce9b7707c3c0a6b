"""Options that hold several values, or a value with something about it."""

import re
from collections.abc import Container, Iterable
from typing import Literal

from flexid.errors import SettingError

_UNCERTAIN = re.compile(r"(.+?)(?:±|\+-)(.+)")


def parse_names(text: str) -> tuple[str, ...]:
    """Names that stand between commas, each once."""
    return tuple(dict.fromkeys(name.strip() for name in text.split(",") if name.strip()))


def parse_known(assignments: Iterable[str]) -> tuple[dict[str, float], dict[str, float]]:
    """Values by name, and standard deviations of those that have one.

    Examples
    --------
    >>> parse_known(["motor_inertia=0.3", "theta2=100+-5"])
    ({'motor_inertia': 0.3, 'theta2': 100.0}, {'theta2': 5.0})
    """
    known: dict[str, float] = {}
    deviations: dict[str, float] = {}
    for assignment in assignments:
        name, _, text = (part.strip() for part in assignment.partition("="))
        _check_new("--known", name, known)
        uncertain = _UNCERTAIN.fullmatch(text)
        try:
            known[name] = float(uncertain[1] if uncertain else text)
            if uncertain:
                deviations[name] = float(uncertain[2])
        except ValueError:
            raise SettingError(
                "--known",
                f"{assignment!r} is no name=number, e.g. motor_inertia=0.3 or 0.3+-0.01",
            ) from None
    return known, deviations


def parse_bounds(assignments: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Lower and upper ends by name; an end left out is infinite.

    Examples
    --------
    >>> parse_bounds(["alpha2=0:", "theta2=50:200"])
    {'alpha2': (0.0, inf), 'theta2': (50.0, 200.0)}
    """
    bounds: dict[str, tuple[float, float]] = {}
    for assignment in assignments:
        name, _, text = (part.strip() for part in assignment.partition("="))
        _check_new("--bounds", name, bounds)
        lower, colon, upper = text.partition(":")
        try:
            if not colon:
                raise ValueError
            bounds[name] = (float(lower or "-inf"), float(upper or "inf"))
        except ValueError:
            raise SettingError(
                "--bounds",
                f"{assignment!r} is no name=lower:upper, e.g. theta2=50:200 or alpha2=0:",
            ) from None
    return bounds


def parse_values(option: str, assignments: Iterable[str]) -> dict[str, float]:
    """Numbers by dotted path.

    Examples
    --------
    >>> parse_values("--set", ["controller.k=30.5", "sampling.seed = 7"])
    {'controller.k': 30.5, 'sampling.seed': 7}
    """
    values: dict[str, float] = {}
    for assignment in assignments:
        name, _, text = (part.strip() for part in assignment.partition("="))
        _check_new(option, name, values)
        try:
            values[name] = _number(text)
        except ValueError:
            raise SettingError(
                option, f"{assignment!r} is no path=number, e.g. controller.k=30"
            ) from None
    return values


def _number(text: str) -> float:
    """A number; a whole one keeps all its digits, since a seed has more than a float holds."""
    try:
        return int(text)
    except ValueError:
        return float(text)


def _check_new(option: str, name: str, before: Container[str]) -> None:
    if name in before:
        raise SettingError(option, f"{name} is given twice: leave one of them out")


def parse_number(option: str, text: str) -> float | Literal["auto"]:
    """A number, or ``auto``."""
    if text == "auto":
        return "auto"
    try:
        return float(text)
    except ValueError:
        raise SettingError(option, f"{text!r} is neither a number nor auto") from None
