"""What every step speaks of, and what tells a user how far a job is."""

from collections.abc import Callable

Progress = Callable[[str], None]
"""Takes a line of text."""


def silent(*_: object) -> None:
    """Say nothing."""
