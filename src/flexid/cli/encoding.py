"""Output on terminals that do not have every character."""

import codecs
import io
import sys


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
