"""What a command's exit status says; the same for all commands."""

from enum import IntEnum


class ExitStatus(IntEnum):
    """How a command ended."""

    DONE = 0
    """All that was asked for is there, and determined where it can be."""

    LACKING = 1
    """Done, but the data cannot support all of it; the answer says what, and why."""

    BAD_INPUT = 2
    """An input, an option or a place to write to cannot be used; one sentence says what to do."""

    INTERRUPTED = 3
    """By Ctrl-C or SIGTERM; nothing half written is left."""

    DEFECT = 70
    """An error of flexid itself, as in sysexits.h; what is printed says how to report it."""
