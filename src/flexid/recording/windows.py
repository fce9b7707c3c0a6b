"""Windows of a stream that overlap, so that each can be filtered by itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from flexid.recording.recording import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from flexid.recording.recording import Recording
    from flexid.recording.stream import Chunk


@dataclass(frozen=True, eq=False)
class Window:
    """A part of a recording, with what lies before and after it."""

    recording: Recording  # the part with its margins
    offset: int  # samples of the recording before these
    start: int  # of the part itself, as samples of the recording
    stop: int
    last: bool  # whether the recording ends here
    row: int  # rows of the file before the first sample of the recording


def windows(
    chunks: Iterable[Chunk], length: int, margin: int, rest: int, fewest: int
) -> Iterator[Window]:
    """Parts of so many samples with margins on both sides, wherever the chunks begin and end.

    A recording's last part is longer by less than 2 `margin` + `rest`, or shorter; it has at least
    `rest` samples beyond the margin. Recordings of less than `fewest` samples are left out.
    """
    parts: list[Recording] = []
    row, offset, start, total = 0, 0, 0, 0

    def window(stop: int, last: bool) -> Window:
        whole = _joined(parts)
        first = max(0, start - margin) - offset
        end = total - offset if last else stop + margin - offset
        recording = whole.window(first, end)
        return Window(recording, offset + first, start, stop, last, row)

    for chunk in chunks:
        if chunk.begins:
            if total >= fewest:
                yield window(total, last=True)
            parts, row, offset, start, total = [], chunk.row, 0, 0, 0
        parts.append(chunk.recording)
        total += len(chunk.recording)
        while total >= start + length + 2 * margin + rest:
            yield window(start + length, last=False)
            start += length
            kept = max(0, start - margin)
            whole = _joined(parts)
            parts = [whole.window(kept - offset, len(whole))]
            offset = kept
    if total >= fewest:
        yield window(total, last=True)


def _joined(parts: list[Recording]) -> Recording:
    """Consecutive recordings as one."""
    if len(parts) == 1:
        return parts[0]
    channels = {}
    for name in CHANNELS:
        values = [getattr(part, name) for part in parts]
        channels[name] = None if values[0] is None else np.concatenate(values)
    whole = replace(parts[0], **channels)
    parts[:] = [whole]
    return whole
