"""Options that hold several values, or a value with something about it, from their texts."""

import re
from collections.abc import Callable, Iterable
from typing import Literal, TypeVar

from flexid.errors import SettingError

_Value = TypeVar("_Value")

_UNCERTAIN = re.compile(r"(.+?)(?:±|\+-)(.+)")


def parse_known(option: str, assignments: Iterable[str]) -> dict[str, float | tuple[float, float]]:
    """Values by name, with the standard deviation of those that have one.

    Examples
    --------
    >>> parse_known("--known", ["motor_inertia=0.3", "theta2=100+-5"])
    {'motor_inertia': 0.3, 'theta2': (100.0, 5.0)}
    """
    return _by_name(option, assignments, _uncertain, "name=number, e.g. beta1=3 or beta1=3+-0.1")


def parse_bounds(option: str, assignments: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Lower and upper ends by name; an end left out is infinite.

    Examples
    --------
    >>> parse_bounds("--bounds", ["alpha2=0:", "theta2=50:200"])
    {'alpha2': (0.0, inf), 'theta2': (50.0, 200.0)}
    """
    wanted = "name=lower:upper, e.g. theta2=50:200 or alpha2=0:"
    return _by_name(option, assignments, _ends, wanted)


def parse_values(option: str, assignments: Iterable[str]) -> dict[str, float]:
    """Numbers by dotted path.

    Examples
    --------
    >>> parse_values("--set", ["controller.k=30.5", "sampling.seed = 7"])
    {'controller.k': 30.5, 'sampling.seed': 7}
    """
    return _by_name(option, assignments, _number, "path=number, e.g. controller.k=30")


def parse_number(option: str, text: str) -> float | Literal["auto"]:
    """A number, or ``auto``."""
    if text == "auto":
        return "auto"
    try:
        return float(text)
    except ValueError:
        raise SettingError(option, f"{text!r} is neither a number nor auto") from None


def _by_name(
    option: str, assignments: Iterable[str], value: Callable[[str], _Value], wanted: str
) -> dict[str, _Value]:
    """What stands behind each name; a `SettingError` for what is no assignment, or stands twice."""
    found: dict[str, _Value] = {}
    for assignment in assignments:
        name, _, text = (part.strip() for part in assignment.partition("="))
        if name in found:
            raise SettingError(option, f"{name} is given twice: leave one of them out")
        try:
            found[name] = value(text)
        except ValueError:
            raise SettingError(option, f"{assignment!r} is no {wanted}") from None
    return found


def _uncertain(text: str) -> float | tuple[float, float]:
    parts = _UNCERTAIN.fullmatch(text)
    return (float(parts[1]), float(parts[2])) if parts else float(text)


def _ends(text: str) -> tuple[float, float]:
    lower, colon, upper = text.partition(":")
    if not colon:
        raise ValueError
    return float(lower or "-inf"), float(upper or "inf")


def _number(text: str) -> float:
    """A number; a whole one keeps all its digits, since a seed has more than a float holds."""
    try:
        return int(text)
    except ValueError:
        return float(text)
