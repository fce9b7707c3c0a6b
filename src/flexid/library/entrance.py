"""What all functions of the front door have in common: how they refuse arguments."""

import inspect
import os
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from flexid.errors import ArgumentError

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


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """What to write instead of a word: the nearest there is, or all there are."""
    names = [*known]
    close = get_close_matches(word, names, n=1, cutoff=0.6)
    return f": did you mean {close[0]}?" if close else f": there are {', '.join(names)}"


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
