"""Arguments of the library's functions: refused in a sentence, or converted; and one thread."""

import inspect
import math
import os
import re
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import wraps
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, TypeAlias, TypedDict, TypeVar

from flexid.errors import ArgumentError, did_you_mean
from flexid.models.arm_file import refuse_arm_file

if TYPE_CHECKING:
    from threadpoolctl import threadpool_limits

    from flexid.arrays import FloatArray
    from flexid.identification.preparation.joint import Kind
    from flexid.identification.preparation.settings import Settings
    from flexid.identification.result.identification import Identification
    from flexid.recording.recording import Hold
    from flexid.streaming.options import StreamChannels

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


P = ParamSpec("P")
R = TypeVar("R")


def entrance(function: Callable[P, R]) -> Callable[P, R]:
    """Make a function answer arguments that it does not have in a sentence."""
    signature = inspect.signature(function)
    name = function.__name__

    @wraps(function)
    def checked(*args: P.args, **kwargs: P.kwargs) -> R:
        for keyword in kwargs:
            if keyword not in signature.parameters:
                raise ArgumentError(
                    name, keyword, f"is no option{did_you_mean(keyword, signature.parameters)}"
                )
        try:
            signature.bind(*args, **kwargs)
        except TypeError as error:
            raise _refused(name, signature, len(args), str(error)) from None
        progress = kwargs.get("progress")
        if progress is not None and not callable(progress):
            raise ArgumentError(
                name, "progress", f"is {kind_of(progress)}: give a function, such as print"
            )
        return function(*args, **kwargs)

    return checked


def _refused(name: str, signature: inspect.Signature, given: int, reason: str) -> ArgumentError:
    """What was wrong with a call whose keywords are all known."""
    parameters = signature.parameters.values()
    positional = [p.name for p in parameters if p.kind is not inspect.Parameter.KEYWORD_ONLY]
    if given > len(positional):
        taken = " and ".join(positional) or "nothing"
        said = f"there are {given} without a name, and it takes {taken}; write options by name"
        return ArgumentError(name, "arguments", said)
    missing = reason.removeprefix("missing a required argument: ")
    if missing != reason:
        return ArgumentError(name, missing.strip("'"), "is missing: give it")
    return ArgumentError(name, "arguments", reason)


def as_path(function: str, argument: str, value: Any) -> Path:
    """A path, if it is one; else an `ArgumentError`."""
    if isinstance(value, str | os.PathLike):
        text = os.fspath(value)
        if isinstance(text, str):
            return Path(text)
    raise ArgumentError(function, argument, f"is {kind_of(value)}: give a path")


def kind_of(value: object) -> str:
    """What a value is, with its article."""
    if value is None:
        return "None"
    name = type(value).__name__
    return f"{'an' if name[0].lower() in 'aeiou' else 'a'} {name}"


_LOCK = threading.Lock()
_active = 0
_limits: "threadpool_limits | None" = None


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep linear algebra to one thread, in a ``with`` or as a decorator of a function.

    Our matrices are small: threads that share them wait for each other longer than they compute.
    The limit holds for the process, so of several calls at once the first sets it and the last one
    takes it back; no call finds what another has set and takes it for the user's.
    """
    global _active, _limits
    with _LOCK:
        if not _active:
            import scipy.linalg  # noqa: F401 - a library that comes later would not be limited
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


_SECTION = re.compile(
    r"(?<=    Parameters\n    ----------\n).*?(?=\n\n    \w+\n    ---|\n    \Z)", re.DOTALL
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
    if argument == "model":
        refuse_arm_file(value)
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


_CHANNELS = {
    "flexible": "link_position or deflection, motor_position and an input",
    "link": "link_position or deflection, motor_position and no input",
    "rigid": "motor_position and an input, and no link",
}


def fed_channels(names: Sequence[str], kind: str) -> "StreamChannels":
    """What a session is fed, by the names of its channels; the kind is asked for, or "auto"."""
    from flexid.recording.channel import INPUTS, SI_UNITS
    from flexid.streaming.options import StreamChannels

    inputs = [name for name in INPUTS if name in names]
    links = [name for name in ("link_position", "deflection") if name in names]
    if len(inputs) > 1 or len(links) > 1 or not inputs + links:
        raise ArgumentError(
            "feed",
            "channels",
            f"are {', '.join(names)}: give one of {', '.join(INPUTS)}, and of link_position and "
            f"deflection one at most; without an input, one of these",
        )
    found = ("flexible" if inputs else "link") if links else "rigid"
    if kind not in ("auto", found):
        raise ArgumentError(
            "feed",
            "channels",
            f"are {', '.join(names)}: for the {kind} joint give {_CHANNELS[kind]}",
        )
    unit = SI_UNITS[inputs[0]][0] if inputs else ""
    return StreamChannels(found, unit, links == ["deflection"], ())


def as_samples(name: str, values: Any) -> "FloatArray":
    """Numbers of a channel, shape (n,); an `ArgumentError` for what is none."""
    import numpy as np

    try:
        found = np.atleast_1d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError):
        raise ArgumentError("feed", name, f"is {kind_of(values)}: give numbers") from None
    if found.ndim != 1:
        raise ArgumentError("feed", name, f"has {found.ndim} dimensions: give one number a sample")
    return found


def as_comparable(estimate: Any) -> "Identification | None":
    """What a stream is held against, if there is something."""
    if estimate is None:
        return None
    from flexid.library.identify import estimated
    from flexid.streaming.options import check_comparable

    found = estimated("watch", "estimate", estimate).of_joint
    check_comparable(found)
    return found
