"""Arguments of every kind: what they are, and paths among them."""

import os
from pathlib import Path
from typing import Any

from flexid.errors import ArgumentError


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
