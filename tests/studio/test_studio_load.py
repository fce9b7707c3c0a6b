"""Many windows at once."""

from __future__ import annotations

import sys

import pytest
from benchmarks.studio import load


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
def test_twenty_windows_stay_within_two_gigabytes():
    """Assert that twenty logs of thirty seconds are checked, some identified, and others answered.

    Waiting for an answer that does not come would end in an error.
    """
    assert load(20, 2).peak_memory < 2e9
