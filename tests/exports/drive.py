"""Exported drives for the tests, compiled with the tools of this machine."""

import shutil
import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent

WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror", "-pedantic")
STRICT = ("-std=c99", *WARNINGS)

PRECISIONS = {"double": "-UFLEXID_FLOAT", "float": "-DFLEXID_FLOAT"}
"""Compiler option of each precision."""

LOG = Path("examples/flexible_joint.csv")

DRIVES = {
    "least squares, encoders": {"log": LOG},
    "least squares, encoders, straight lines": {"sample_time": 1e-3, "hold": "linear"},
    "velocities from positions": {
        "sample_time": 1e-3,
        "terms": ("gravity", "motor_viscous", "motor_coulomb"),
        "filter_rate": 50.0,
    },
}
"""Options of an export, for every kind of estimator."""

MAIN = "least squares, encoders"
"""Name of the estimator for the example log."""

CASES = [
    (MAIN, "double"),
    *(pytest.param(name, "float", marks=pytest.mark.thorough) for name in DRIVES),
]
"""Analysed builds; a double build differs in its type and six numbers."""


def tool(name: str) -> str:
    """Return the path of a program, or skip the test."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed")
    return found


def run(*command: str | Path, cwd: Path | None = None, timeout: float = 240.0) -> str:
    """Return the output of a command, which must succeed."""
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, capture_output=True, text=True, timeout=timeout
    )
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout + done.stderr


def compiled(compiler: str, directory: Path, *options: str, out: Path) -> Path:
    """Compile the example of an exported drive and return its path."""
    sources = [directory / "example_main.c", directory / "flexid_drive.c"]
    run(tool(compiler), *STRICT, "-O2", *options, *sources, "-lm", "-o", out)
    return out
