"""What is said when flexid itself is wrong."""

import platform
import sys
import tempfile
import traceback
from collections.abc import Sequence

from flexid.report.terminal import USUAL, wrapped


def defect_message(error: Exception, arguments: Sequence[str]) -> str:
    """One paragraph: what happened, and how to report it.

    The traceback goes into a temporary file.
    """
    command = " ".join(["flexid", *arguments])
    again = " ".join(["flexid", "--debug", *arguments])
    said = (
        f"flexid: this is a defect of flexid, not of your input: {type(error).__name__} "
        f"({str(error) or 'without a message'}). Please report it where you got flexid from, "
    )
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="flexid-defect-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            file.write(f"{command}\n{_versions()}\n\n{''.join(traceback.format_exception(error))}")
        said += (
            f"with the file {file.name}: it holds the command, the versions and the traceback, and "
            f"none of your data. To see the traceback here: {again}"
        )
    except OSError:
        said += f"with what this prints: {again}"
    return "\n".join(wrapped(said, USUAL))


def _versions() -> str:
    from importlib.metadata import version

    names = ("flexid", "numpy", "scipy", "numba", "polars")
    found = ", ".join(f"{name} {version(name)}" for name in names)
    return f"{found}, Python {platform.python_version()}, {sys.platform}"
