"""Windows overlap as they should, whatever the chunks."""

from dataclasses import dataclass

import numpy as np
import pytest

from flexid.recording.recording import Recording
from flexid.recording.stream import Chunk
from flexid.recording.windows import Window, windows


def chunks(lengths: list[int], size: int) -> list[Chunk]:
    """Recordings whose samples are numbered through, in chunks of a size."""
    found, row = [], 0
    for length in lengths:
        for first in range(0, length, size):
            count = min(size, length - first)
            values = np.arange(row, row + count, dtype=np.float64)
            recording = Recording(1e-3, 1e-3 * row, None, values, values, "N m")
            found.append(Chunk(recording, first == 0, row))
            row += count
    return found


@dataclass(frozen=True)
class _Seen:
    row: int
    offset: int
    start: int
    stop: int
    last: bool
    first_value: float
    count: int


def seen(window: Window) -> _Seen:
    """What tells a window from others."""
    recording = window.recording
    return _Seen(
        window.row, window.offset, window.start, window.stop, window.last,
        float(recording.needed_input[0]), len(recording),
    )  # fmt: skip


@pytest.mark.parametrize("size", [1, 7, 100, 5000])
def test_windows_do_not_depend_on_chunks(size: int):
    """Assert that every chunking gives the windows of the whole file."""
    lengths = [1000, 30, 250, 4000]
    of_all = [seen(w) for w in windows(chunks(lengths, 10**6), 300, 40, 25, 50)]
    assert [seen(w) for w in windows(chunks(lengths, size), 300, 40, 25, 50)] == of_all


def test_windows_cover_the_recordings():
    """Assert that parts follow one another, with their margins, and leave short recordings out."""
    found = list(windows(chunks([1000, 30, 250], 64), 300, 40, 25, 50))
    assert [w.row for w in found if w.last] == [0, 1030]
    reached = 0
    for window in found:
        if window.row != 0:
            continue
        assert window.start == reached
        assert window.offset == max(0, window.start - 40)
        end = window.offset + len(window.recording)
        assert end == (1000 if window.last else window.stop + 40)
        np.testing.assert_array_equal(window.recording.input, np.arange(window.offset, end))
        reached = window.stop
    assert reached == 1000
