"""What all functions of the front door have in common: refusals, one thread, shared options."""

import inspect
import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

from flexid.errors import ArgumentError, did_you_mean

if TYPE_CHECKING:
    from threadpoolctl import threadpool_limits

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
        options = [p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY]
        taken = " and ".join(positional) or "nothing"
        return ArgumentError(
            name,
            "arguments",
            f"there are {given} without a name, and it takes {taken}; write options by name, "
            f"such as {options[0]}=..."
            if options
            else f"there are {given}, and it takes {taken}",
        )
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
    """Keep linear algebra to one thread.

    Our matrices are small: threads that share them wait for each other longer than they compute.
    The limit holds for the process, so of several calls at once the first sets it and the last one
    takes it back; no call finds what another has set and takes it for the user's.
    """
    _enter()
    try:
        yield
    finally:
        _leave()


def in_one_thread(function: Callable[P, R]) -> Callable[P, R]:
    """A function that works with one thread for linear algebra."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> R:
        with one_thread():
            return function(*args, **kwargs)

    return limited


def _enter() -> None:
    global _active, _limits
    with _LOCK:
        if not _active:
            import scipy.linalg  # noqa: F401 - a library that comes later would not be limited
            from threadpoolctl import threadpool_limits

            _limits = threadpool_limits(limits=1, user_api="blas")
        _active += 1


def _leave() -> None:
    global _active, _limits
    with _LOCK:
        _active -= 1
        if not _active and _limits is not None:
            _limits.restore_original_limits()
            _limits = None


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
