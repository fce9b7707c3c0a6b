"""Arguments of the public functions, checked and converted; linear algebra in one thread."""

from __future__ import annotations

import inspect
import math
import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial, wraps
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, TypeAlias, TypeVar

from flexid.errors import ArgumentError, check_names
from flexid.files import refuse_arm_file

if TYPE_CHECKING:
    from threadpoolctl import threadpool_limits

    from flexid.identification.preparation.joint import Kind
    from flexid.identification.preparation.settings import Settings
    from flexid.recording.recording import Hold

    FilePath: TypeAlias = str | os.PathLike[str]
    """Path of a file."""
    Known: TypeAlias = Mapping[str, float | tuple[float, float]]
    """Values by name, each alone or with its standard deviation."""
    Bounds: TypeAlias = Mapping[str, tuple[float | None, float | None]]
    """Lower and upper bound by name; None leaves a side unbounded."""
    Terms: TypeAlias = str | Iterable[str]
    """Names of terms, or "auto"."""
    AutoModel: TypeAlias = Kind | Literal["auto"]
    """Model of the joint, or "auto"."""
    AutoHold: TypeAlias = Hold | Literal["auto"]
    """Input between samples, or "auto"."""
    AutoNumber: TypeAlias = float | Literal["auto"]
    """A number, or "auto"."""


P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T")


class _UnfitError(Exception):
    """An argument, or a part of it, does not have its declared type."""

    def __init__(self, reason: str, part: str = "") -> None:
        self.reason, self.part = reason, part


def entrance(function: Callable[P, R]) -> Callable[P, R]:
    """Return a function that checks and converts its arguments before it runs."""
    signature = inspect.signature(function)
    name = function.__name__

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            given = signature.bind(*args, **kwargs)
        except TypeError as error:
            raise ArgumentError(name, "arguments", f"do not fit, {error}") from None
        for argument, value in given.arguments.items():
            try:
                given.arguments[argument] = _as_declared(signature.parameters[argument], value)
            except _UnfitError as unfit:
                raise ArgumentError(name, f"{argument}{unfit.part}", unfit.reason) from None
        return function(*given.args, **given.kwargs)

    return checked


def _as_declared(parameter: inspect.Parameter, value: Any) -> Any:
    """Return a value converted to the declared type of its parameter."""
    declared = parameter.annotation
    if not isinstance(declared, str):  # of a module that evaluates its annotations
        declared = re.sub(r"[\w.]*\.", "", inspect.formatannotation(declared))
    kind = declared.removesuffix(" | None")
    if value is None and (kind != declared or parameter.default is None):
        return None
    if kind in _CONVERTED:
        return _CONVERTED[kind](value)
    choices = re.findall(r"'(\w+)'", kind)  # of a Literal
    kinds = ["str"] if choices else kind.split(" | ")
    own = {base.__name__ for base in type(value).__mro__}
    if {*kinds} & {*_TYPES} and not {*kinds} & own:
        known = [_TYPES.get(each, ((), f"a {each}")) for each in kinds]
        _check(value, tuple(types for types, _ in known), " or ".join(words for _, words in known))
    if choices:
        check_names(parameter.name, (str(value),), choices)
    return value


def _check(value: Any, types: Any, wanted: str, part: str = "") -> None:
    if isinstance(value, bool) or not isinstance(value, types):
        raise _UnfitError(f"is {kind_of(value)}: give {wanted}", part)
    if isinstance(value, str) and not value and "path" in wanted:  # Path("") is a folder
        raise _UnfitError(f"is empty: give {wanted}", part)


def kind_of(value: object) -> str:
    """Return the name of a value's type with its article, such as "an int"."""
    if value is None:
        return "None"
    name = type(value).__name__
    return f"{'an' if name[0].lower() in 'aeiou' else 'a'} {name}"


_LOCK = threading.Lock()
_active = 0
_limits: threadpool_limits | None = None


# The matrices are small, so that several threads would only slow the computation. The limit is one
# for the process: the first of several concurrent calls sets it, and the last one restores it.
@contextmanager
def one_thread() -> Iterator[None]:
    """Limit linear algebra to one thread; a context manager that also decorates functions."""
    global _active, _limits
    with _LOCK:
        if not _active:
            import scipy.linalg  # noqa: F401 - only libraries that are loaded are limited
            from threadpoolctl import threadpool_limits

            _limits = threadpool_limits(limits=1, user_api="blas")
        _active += 1
    try:
        yield
    finally:
        with _LOCK:
            _active -= 1
            if not _active and _limits is not None:
                _limits.restore_original_limits()
                _limits = None


_SECTION = re.compile(r"(?<=\nParameters\n----------\n).*?(?=\n\n\w+\n---|\Z)", re.DOTALL)
_ENTRY = re.compile(r"^(\w[\w, ]*) : (.*)\n((?: .*\n?)+)", re.MULTILINE)


def described(function: Callable[..., object]) -> dict[str, tuple[str, str]]:
    """Return the type and the indented description of each parameter of a docstring."""
    section = _SECTION.search(inspect.getdoc(function) or "")
    return {
        name.strip(): (kind, words)
        for names, kind, words in _ENTRY.findall(section[0] if section else "")
        for name in names.split(",")
    }


def options_of(
    other: Callable[P, object], *left_out: str
) -> Callable[[Callable[..., R]], Callable[P, R]]:
    """Return a decorator that replaces ``**options`` by the parameters of another function."""
    shared = inspect.signature(other).parameters
    names = [name for name in shared if name not in left_out]

    def spelt_out(function: Callable[..., R]) -> Callable[P, R]:
        signature, words = inspect.signature(function), described(other) | described(function)
        text = "\n".join("{} : {}\n{}".format(name, *words[name]).rstrip() for name in names)
        parameters = [signature.parameters.get(name, shared[name]) for name in names]
        function.__doc__ = _SECTION.sub(lambda _: text, inspect.getdoc(function) or "", count=1)
        signature = signature.replace(parameters=parameters)
        setattr(function, "__signature__", signature)  # noqa: B010, functions do not declare it
        return function

    return spelt_out


def joint_settings(
    *, known: Known | None = None, bounds: Bounds | None = None, **options: Any
) -> Settings:
    """Return the settings of an identification, with defaults for options not given."""
    from flexid.identification.preparation.settings import Settings

    values, deviations = with_deviations(known)
    found: Any = bounds or {}  # converted, without None
    return Settings(known=values, known_deviations=deviations, bounds=found, **options)


def with_deviations(known: Known | None) -> tuple[dict[str, float], dict[str, float]]:
    """Return the values by name, and by name the standard deviations that were given."""
    pairs = {name: v if isinstance(v, tuple) else (v,) for name, v in (known or {}).items()}
    values = {name: pair[0] for name, pair in pairs.items()}
    return values, {name: pair[1] for name, pair in pairs.items() if len(pair) > 1}


def _model(value: Any) -> str:
    _check(value, str, "a name such as 'link'")
    refuse_arm_file(value)
    return value


def _number(value: Any, part: str = "") -> float:
    _check(value, Real, "a number", part)
    try:
        return float(value)
    except OverflowError:
        raise _UnfitError("is too large: give a number below 1e308", part) from None


def _auto_number(value: Any) -> Any:
    if isinstance(value, str):
        if value == "auto":
            return value
        raise _UnfitError(f"is {value!r}: give a number, or 'auto'")
    return _number(value)


def _by_name(value: Any, example: str, convert: Callable[[Any, str], T] = _number) -> dict[str, T]:
    """Return a mapping by name with each value converted."""
    _check(value, Mapping, f"a mapping such as {example}")
    for name in value:
        if not isinstance(name, str):
            raise _UnfitError(f"has the key {name!r}: give names, as in {example}")
    return {name: convert(given, f"[{name!r}]") for name, given in value.items()}


def _terms(value: Any) -> Any:
    return value if isinstance(value, str) and value in ("auto", "usual") else _names(value)


def _names(value: Any) -> tuple[str, ...]:
    """Return the distinct names of an iterable, or of a text with commas."""
    if isinstance(value, str):
        value = [name.strip() for name in value.split(",") if name.strip()]
    names = tuple(value) if isinstance(value, Iterable) else (value,)
    wrong = [name for name in names if not isinstance(name, str)]
    if wrong:
        raise _UnfitError(f"contains {kind_of(wrong[0])}: give names such as ['gravity']")
    return tuple(dict.fromkeys(names))


def _uncertain(value: Any, part: str) -> float | tuple[float, float]:
    """Return a value, or a value with its standard deviation."""
    pair = value if isinstance(value, list | tuple) else (value,)
    if len(pair) not in (1, 2):
        raise _UnfitError("is neither a value nor (value, standard deviation)", part)
    number, *deviation = (_number(each, part) for each in pair)
    return (number, deviation[0]) if deviation else number


def _ends(value: Any, part: str) -> tuple[float, float]:
    """Return a lower and an upper bound; None becomes infinite."""
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise _UnfitError("is not a pair (lower, upper): give both, None for no bound", part)
    lower, upper = (
        infinite if end is None else _number(end, part)
        for end, infinite in zip(value, (-math.inf, math.inf), strict=True)
    )
    return lower, upper


def _logs(value: Any) -> list[Any]:
    several = value if isinstance(value, list | tuple) else [value]
    if not several:
        raise _UnfitError(f"is an empty list: give {_LOG}")
    return [*map(_log, several)]


def _log(value: Any) -> Any:
    if isinstance(value, _PATH):  # first, since data frames are slow to import
        _check(value, _PATH, _LOG)
        return value
    from flexid.recording.frame import is_frame
    from flexid.recording.recording import Log, Recording

    if not is_frame(value):
        _check(value, (Mapping, Log, Recording), _LOG)
    return value


_LOG = "a path, a data frame, a mapping of arrays, a Log, or a list of these"
_PATH = (str, os.PathLike)
_RANGES = "{'theta2': (50, 200), 'alpha2': (0, None)}"
_VALUES = "{'motor_inertia': 0.3} or {'motor_inertia': (0.3, 0.01)}"
_CONVERTED: Mapping[str, Callable[[Any], Any]] = {
    "AutoModel": _model,
    "AutoNumber": _auto_number,
    "Bounds": partial(_by_name, example=_RANGES, convert=_ends),
    "Collection[str]": _names,
    "Iterable[str]": _names,
    "Known": partial(_by_name, example=_VALUES, convert=_uncertain),
    "Logs": _logs,
    "Mapping[str, float]": partial(_by_name, example="{'name': 30.0}"),
    "OneLog": _log,
    "Terms": _terms,
}
"""Function that converts an argument, by its annotation."""

_TYPES: Mapping[str, tuple[Any, str]] = {
    "Axes": ((), "axes of Matplotlib"),
    "AutoHold": (str, "a name such as 'zero'"),
    "Callable[[int, int], None]": (Callable, "a function"),
    "Columns": ((*_PATH, Mapping), "the path of a column map, or a mapping of channels to columns"),
    "FilePath": (_PATH, "a path"),
    "Mapping[str, Any]": (Mapping, "the content of an estimate.json"),
    "ParametricSystem": ((), "a model such as flexid.flexible_joint()"),
    "Path": (_PATH, "a path"),
    "Progress": (Callable, "a function, such as print"),
    "Thresholds": ((), "a flexid.Thresholds"),
    "float": (Real, "a number"),
    "int": (int, "a whole number"),
    "str": (str, "text"),
}
"""Types of an argument and their description, by its annotation or a part of the annotation."""
