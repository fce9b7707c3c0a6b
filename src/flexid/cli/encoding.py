"""Output on terminals that do not have every character, and where there is no output at all."""

import codecs
import io
import os
import sys


def open_what_is_closed() -> None:
    """Open standard streams that were closed (``>&-``) on the null device.

    Without it the first file that is opened takes their number, and what is printed lands in it.
    """
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:  # the lowest that is free
        pass
    os.close(number)
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115 - it stays open
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115 - it stays open


def spell_what_cannot_be_encoded() -> None:
    """Let standard output and error spell what their encoding lacks: alpha2 for α₂, +- for ±."""
    codecs.register_error("flexid.spelled", _spelled)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="flexid.spelled")


def _spelled(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    from flexid.report.terminal import spelled

    return spelled(error.object[error.start : error.end]), error.end
