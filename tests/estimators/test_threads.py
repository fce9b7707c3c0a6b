"""Ranges of segments, shared among threads."""

import threading

import numpy as np
import pytest

import flexid.estimators.segments as sharing
from flexid.estimators.segments import in_threads


@pytest.mark.parametrize("lengths", [[30_000], [20] * 3, [1_000] * 37, [50_000, 20, 20, 9_000]])
@pytest.mark.parametrize("cores", [1, 2, 7])
def test_every_segment_is_done_once(
    monkeypatch: pytest.MonkeyPatch, lengths: list[int], cores: int
):
    """Assert that the ranges cover all segments, none of them twice."""
    monkeypatch.setattr(sharing, "cores", lambda: cores)
    done = np.zeros(len(lengths), dtype=int)

    def run(first: int, stop: int) -> None:
        done[first:stop] += 1

    in_threads(run, np.array(lengths, dtype=np.int64))
    np.testing.assert_array_equal(done, 1)


def test_long_records_have_several_threads(monkeypatch: pytest.MonkeyPatch):
    """Assert that two cores run at the same time: each waits for the other."""
    monkeypatch.setattr(sharing, "cores", lambda: 2)
    together = threading.Barrier(2, timeout=30.0)

    def run(_first: int, _stop: int) -> None:
        together.wait()

    in_threads(run, np.full(100, 1_000))
