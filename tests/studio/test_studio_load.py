"""Many windows at once."""

from __future__ import annotations

import sys

import pytest
from benchmarks.studio import load


@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc")
def test_twenty_windows_stay_within_two_gigabytes():
    """Assert that twenty logs of thirty seconds are checked, some identified, and others answered.

    Another window watches the simulated drive meanwhile, whose samples go on coming. Waiting for an
    answer that does not come would end in an error.
    """
    found = load(20, 2)
    assert found.peak_memory < 2e9
    assert found.streamed > 1.0  # two pieces, of which the first came before the logs
