"""What every command has in common."""

import subprocess
import sys
from pathlib import Path

import pytest

FULL = Path("/dev/full")


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
        "flexid: the output or the cache cannot be written (No space left on device): "
        "make room, or write elsewhere"
    ]
