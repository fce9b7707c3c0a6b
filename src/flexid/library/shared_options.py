"""Options that a function takes as another does: its signature and its documentation, once."""

import inspect
import re
from collections.abc import Callable
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_SECTION = re.compile(
    r"(?<=    Parameters\n    ----------\n).*?(?=\n\n    \w+\n    ---)", re.DOTALL
)
_ENTRY = re.compile(r"^    (\w+) : .*\n(?:        .*\n?)*", re.MULTILINE)


def options_of(
    other: Callable[..., object], *left_out: str
) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """A decorator that spells out ``**options`` with the parameters of another function."""
    shared = inspect.signature(other).parameters
    entries = _entries(other)

    def spelt_out(function: Callable[P, R]) -> Callable[P, R]:
        signature, own = inspect.signature(function), _entries(function)
        names = [name for name in shared if name not in left_out]
        text = "\n".join(own.get(name, entries[name]).rstrip() for name in names)
        parameters = [signature.parameters.get(name, shared[name]) for name in names]
        function.__doc__ = _SECTION.sub(lambda _: text, function.__doc__ or "", count=1)
        signature = signature.replace(parameters=parameters)
        setattr(function, "__signature__", signature)  # noqa: B010, functions do not declare it
        return function

    return spelt_out


def _entries(function: Callable[..., object]) -> dict[str, str]:
    """What a docstring says of each parameter."""
    section = _SECTION.search(function.__doc__ or "")
    return {} if section is None else {m[1]: m[0] for m in _ENTRY.finditer(section[0])}
