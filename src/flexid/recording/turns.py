"""Values of several clocks in turns: each of a span of time for which all clocks have theirs."""

from __future__ import annotations

from math import inf, isinf
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexid.errors import RecordingError
from flexid.readers.contents import STAMPS
from flexid.recording.one_clock import AROUND, values_around

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    import polars

    from flexid.arrays import FloatArray

_MOST = 20_000_000  # values that wait
_MORE = 1.2  # times as many values are waited for where a clock still has none


class Turn(NamedTuple):
    """What a file holds of a span of time, with some values from around it, by clock."""

    begin: float  # s, after which it begins
    end: float  # s, at which it ends
    stamps: dict[str, FloatArray]  # s
    frames: dict[str, polars.DataFrame]
    late: dict[str, str]  # what to say of values that came too late for their turn

    @property
    def is_together(self) -> bool:
        """Whether the clocks have some time in common."""
        clocks = self.stamps.values()
        return min(map(len, clocks)) > 1 and max(t[0] for t in clocks) < min(t[-1] for t in clocks)


def turns(
    file: str,
    frames: Iterable[tuple[str, polars.DataFrame]],
    clocks: Collection[str],
    size: int | None,
) -> Iterator[Turn]:
    """Spans of about so many values of the fastest clock, or everything at once.

    Values wait until each clock has its own; one that is written far behind the others in the file
    keeps theirs in memory. Stamps that are whole nanoseconds are put in order, and count from the
    first of them all. With a size, damage is raised after the turns before it.
    """
    held, damage = _Held(clocks), None
    try:
        for clock, frame in frames:
            held.add(clock, frame)
            if size is not None:
                yield from held.taken(size)
                if held.rows > _MOST:
                    raise RecordingError(
                        file,
                        "",
                        f"one channel stands more than {_MOST} values behind another in the file: "
                        f"sort the file by time",
                    )
    except RecordingError as error:
        if size is None or held.is_empty:
            raise
        damage = error
    yield from held.taken(size, is_all=True)
    if damage is not None:
        raise damage


class _Held:
    """Values that wait for those of other clocks."""

    def __init__(self, clocks: Collection[str]) -> None:
        self._waiting: dict[str, list[polars.DataFrame]] = {clock: [] for clock in clocks}
        self.rows, self._enough = 0, 0  # values that wait, and from how many on turns are sought
        self._done: float = -inf  # stamp up to which turns were taken
        self._origin: int | None = None
        self._late: dict[str, str] = {}

    @property
    def is_empty(self) -> bool:
        """Whether nothing waits."""
        return not any(self._waiting.values())

    def add(self, clock: str, frame: polars.DataFrame) -> None:
        """Add values in the order of the file."""
        stamps = frame[STAMPS]
        if stamps.dtype.is_integer() and self._done > -inf and stamps.min() <= self._done:  # pyright: ignore[reportOptionalOperand, reportOperatorIssue]
            frame = frame.filter(stamps > self._done)
            self._late[clock] = (
                f"messages of {clock!r} that stand behind {AROUND} later ones are left out: sort "
                f"the file by time"
            )
        self._waiting[clock].append(frame)
        self.rows += frame.height

    def taken(self, size: int | None, *, is_all: bool = False) -> Iterator[Turn]:
        """The turns for which there is all that is needed; the rest of what is held at the end."""
        if not is_all and self.rows < self._enough:
            return
        frames = {clock: self._joined(clock) for clock in self._waiting}
        stamps = {clock: frame[STAMPS].to_numpy() for clock, frame in frames.items()}
        # Where a clock runs backwards the turn is refused in which it does.
        ordered = {clock: np.maximum.accumulate(times) for clock, times in stamps.items()}
        around = values_around(ordered)
        ends = self._ends(ordered, around, size, is_all=is_all)
        first = [times[0] for times in ordered.values() if times.dtype.kind == "i" and len(times)]
        if ends and first and self._origin is None:
            self._origin = int(min(first))
        for end in ends:
            begin, self._done = self._done, end
            parts = {}
            for clock, times in ordered.items():
                start = int(np.searchsorted(times, begin, "right")) - around[clock]
                stop = int(np.searchsorted(times, end, "right")) + around[clock]
                parts[clock] = slice(max(0, start), stop)
            yield Turn(
                self._seconds(begin),
                self._seconds(end),
                {clock: self._seconds(stamps[clock][part]) for clock, part in parts.items()},
                {clock: frames[clock][part] for clock, part in parts.items()},
                self._late,
            )
        for clock, times in ordered.items():
            start = max(0, int(np.searchsorted(times, self._done, "right")) - around[clock])
            self._waiting[clock] = [frames[clock][start:]] if len(times) else []
        self.rows = sum(frame.height for held in self._waiting.values() for frame in held)
        self._enough = 0 if ends else int(_MORE * self.rows)

    def _ends(
        self,
        stamps: dict[str, np.ndarray],
        around: dict[str, int],
        size: int | None,
        *,
        is_all: bool,
    ) -> list[float]:
        """Stamps at which turns end."""
        if size is None:
            return [inf]
        settled = min(
            times[-around[clock] - 1] if len(times) > around[clock] else -inf
            for clock, times in stamps.items()
        )
        fastest = max(stamps.values(), key=len)
        inner = fastest[(fastest > self._done) & (is_all | (fastest <= settled))]
        if is_all:
            return [*inner[size - 1 : -1 : size].tolist(), inf]
        return inner[size - 1 :: size].tolist()

    def _joined(self, clock: str) -> polars.DataFrame:
        import polars as pl

        frames = self._waiting[clock]
        if not frames:
            return pl.DataFrame(schema={STAMPS: pl.Int64})
        frame = pl.concat(frames)
        return frame.sort(STAMPS, maintain_order=True) if frame[STAMPS].dtype == pl.Int64 else frame

    def _seconds(self, stamps: Any) -> Any:
        """Stamps, or one, as seconds."""
        if self._origin is None or (isinstance(stamps, float) and isinf(stamps)):
            return stamps
        return 1e-9 * (stamps - self._origin)
