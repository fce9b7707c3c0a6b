"""What every command has in common."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

FULL = Path("/dev/full")

# What takes a quarter of a second or more to import, and a log in SI units with kernels at hand
# does not need.
HEAVY = (
    "sympy",
    "matplotlib",
    "scipy.interpolate",
    "scipy.optimize",
    "scipy.signal",
    "scipy.stats",
)

IDENTIFY = f"""
import sys
from flexid.cli.main import main
try:
    main()
except SystemExit as end:
    assert end.code == 0, end.code
print([name for name in {HEAVY} if name in sys.modules], file=sys.stderr)
"""


@pytest.mark.skipif(not FULL.exists(), reason="no device that is always full")
def test_full_disk_is_one_sentence():
    """Assert that output that cannot be written exits 2 with one line."""
    with FULL.open("w") as full:
        outcome = subprocess.run(
            [sys.executable, "-c", "from flexid.cli.main import main; main()", "--help"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert outcome.returncode == 2
    assert outcome.stderr.splitlines() == [
        "flexid: the output cannot be written (No space left on device): "
        "make room, or write elsewhere"
    ]


@pytest.mark.skipif(os.name != "posix", reason="a shell that closes streams")
@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_no_defect(closed: str):
    """Assert that a command works where nobody listens."""
    command = f'"{sys.executable}" -m flexid derive flexible-joint {closed}'
    done = subprocess.run(command, shell=True, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_identification_starts_light(examples: Path):
    """Assert that a second identification imports none of the packages that are slow to start."""
    command = [sys.executable, "-c", IDENTIFY, "identify", str(examples / "flexible_joint.csv")]
    subprocess.run(command, capture_output=True, check=True)  # may have kernels to make
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stderr.splitlines()[-1] == "[]"
