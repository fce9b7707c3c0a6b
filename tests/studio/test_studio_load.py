"""Many windows at once."""

from __future__ import annotations

import sys

import pytest
from benchmarks.studio import load


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
def test_twenty_windows_stay_within_two_gigabytes():
    """Assert that twenty logs are checked, some identified, and others answered without waiting."""
    assert load(20, 2).peak_memory < 2e9
