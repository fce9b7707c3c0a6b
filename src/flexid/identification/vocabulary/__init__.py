"""Types that all steps share, and the callback that reports progress."""

from collections.abc import Callable

Progress = Callable[[str], None]
"""Callback that takes a line of text."""


def silent(*_: object) -> None:
    """Ignore the progress text."""
