"""What tells a user how far a job is."""

from collections.abc import Callable

Progress = Callable[[str], None]
"""Takes a line of text."""

Advance = Callable[[int, int], None]
"""Takes what is done, and what there is to do."""


def silent(*_: object) -> None:
    """Say nothing."""
