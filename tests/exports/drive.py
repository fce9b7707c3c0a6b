"""Exported drives for the tests: written once, compiled as a user would, with what is there."""

import shutil
import subprocess
from pathlib import Path

import pytest

WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-pedantic")
STRICT = ("-std=c99", *WARNINGS)

LOG = Path("examples/flexible_joint.csv")


def tool(name: str) -> str:
    """A program, or the test is skipped."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def run(*command: str | Path, cwd: Path | None = None, timeout: float = 300.0) -> str:
    """What a command prints; it must end well."""
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, capture_output=True, text=True, timeout=timeout
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout + done.stderr


def compiled(compiler: str, directory: Path, *options: str, out: Path) -> Path:
    """The example of an exported drive, compiled."""
    run(
        tool(compiler),
        *STRICT,
        "-O2",
        *options,
        directory / "example_main.c",
        directory / "flexid_drive.c",
        "-lm",
        "-o",
        out,
    )
    return out
