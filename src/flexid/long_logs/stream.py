"""Identification of a log of any length, in one pass over its file.

What is chosen for the user is chosen on the head of the log, in memory, as for any log. Then the
whole log streams through least squares with these choices, while short stretches of it, spread
evenly, are kept out of the fit and predicted in the end.
"""

from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from flexid.errors import SettingError
from flexid.estimators.streamed_least_squares import Products
from flexid.identification.identify import identify
from flexid.identification.preparation.alignment import aligned
from flexid.identification.preparation.settings import Settings
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.progress import Advance, Progress, silent
from flexid.long_logs.stream_result import stream_result
from flexid.long_logs.stream_task import HeldOut, StreamTask, stream_task
from flexid.recording.recording import CHANNELS, Recording
from flexid.recording.stream import LogStream
from flexid.recording.velocities import with_velocities
from flexid.recording.windows import Window, windows

if TYPE_CHECKING:
    from flexid.recording.column_map import MapSource

HEAD_ROWS = 120_000
"""Samples at the beginning that choices are made on: two minutes at 1 kHz."""

_WINDOW = 65_536  # samples that are worked on at once
_FEWEST_SAMPLES = 75  # of a recording
_FREE_RUNS = 8  # stretches that are kept out of the fit


def identify_stream(
    path: Path,
    columns: "MapSource | None" = None,
    settings: Settings | None = None,
    progress: Progress = silent,
    advance: Advance = silent,
    workers: int = 2,
) -> Identification:
    """Identify a joint from a Parquet file in one pass, in bounded memory."""
    settings = settings or Settings()
    if settings.model != "auto":
        raise SettingError("model", "is that of the channels in a stream: leave it")
    progress("reading the head")
    stream = LogStream(path, columns, HEAD_ROWS)
    head = identify([stream.head], settings, progress)
    task = stream_task(stream, head, settings)
    progress("streaming")
    held_out = _pass(task, stream, advance, workers)
    progress("predicting the stretches kept out")
    return stream_result(task, stream, head, settings, held_out)


def _pass(task: StreamTask, stream: LogStream, advance: Advance, workers: int) -> list[HeldOut]:
    """Stream the whole log through the sums; return what was kept out."""
    block = task.problem.block
    length = max(1, round(max(_WINDOW, task.margin) / block)) * block
    stretches = windows(stream.chunks(), length, task.margin, block, _FEWEST_SAMPLES)
    held_out = []
    pending: deque[Future[tuple[Products, HeldOut | None]]] = deque()

    def collect() -> None:
        products, held = pending.popleft().result()
        task.sums.add(products)
        if held is not None:
            held_out.append(held)

    with ThreadPoolExecutor(workers) as pool:
        try:
            for window, kept_out in _with_marks(stretches, stream.rows):
                pending.append(pool.submit(_products, task, window, kept_out))
                advance(window.row + window.stop, stream.rows)
                if len(pending) > workers:
                    collect()
            while pending:
                collect()
        finally:
            for future in pending:
                future.cancel()
    return held_out


def _with_marks(stretches: Iterable[Window], rows: int) -> Iterator[tuple[Window, bool]]:
    """Each window, and whether a stretch at its end is kept out: `_FREE_RUNS` of them, evenly."""
    reported = 0
    for window in stretches:
        reached = (window.row + window.stop) * _FREE_RUNS // rows
        yield window, reached > reported
        reported = max(reported, reached)


def _products(task: StreamTask, window: Window, kept_out: bool) -> tuple[Products, HeldOut | None]:
    """Products of a window's equations, and the stretch at its end that is kept out."""
    recording = window.recording
    if task.shifted:
        recording = aligned(recording, task.alignment)
    if task.half_windows is not None:
        recording = with_velocities(recording, task.half_windows)
    samples = task.joint.samples(recording)
    skipped = window.start - window.offset
    # Of a recording's last window, all equations there are; alignment may have made it shorter.
    stop = len(samples) - 2 if window.last else window.stop - window.offset
    products = task.problem.products(samples, skipped, stop - skipped, window.offset == 0)
    if not kept_out:
        return products, None
    taken = min(task.free_run_blocks, len(products.lengths) // 3)
    if taken == 0:
        return products, None
    out = Products(tuple(row[-taken:].copy() for row in products.rows), products.lengths[-taken:])
    length = sum(out.lengths)
    stretch = recording.window(stop - 2 * length, stop)
    return products, HeldOut(_copied(stretch), length, out)


def _copied(recording: Recording) -> Recording:
    """The recording with channels of its own, so that the window they are from can go."""
    channels = {
        name: values.copy() for name in CHANNELS if (values := getattr(recording, name)) is not None
    }
    return replace(recording, **channels)
