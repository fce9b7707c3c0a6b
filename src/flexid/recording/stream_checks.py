"""Checks of a log that streams by: what is carried from chunk to chunk."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from flexid.recording import checks
from flexid.recording.caution import Caution, Rank

if TYPE_CHECKING:
    from flexid.arrays import FloatArray
    from flexid.recording.channel import Channel

FROZEN = 5.0
"""Seconds without change after which a position counts as frozen if the other one moves."""

SHOWN = 3
"""Times that a warning names."""


@dataclass
class Wraps:
    """Wraps of one absolute encoder, undone across chunks.

    Parameters
    ----------
    file, name, column : str
        For messages.
    offset : float, optional
        What is added to the channel, in rad: whole turns.
    """

    file: str
    name: str
    column: str
    offset: float = 0.0
    _last: float = np.nan  # as it was read
    _times: list[str] = field(default_factory=list)
    _count: int = 0

    def undone(self, channel: Channel, time: FloatArray) -> Channel:
        """Return the channel without jumps by a turn, going on where the last chunk ended."""
        raw = channel.values
        started = int(np.isfinite(self._last))
        values = np.concatenate(([self._last] * started, raw))
        times = np.concatenate((time[:started], time))
        unwrapped, warning = checks.unwrap(
            self.file, self.name, replace(channel, values=values), times
        )
        found = unwrapped[started:]
        if warning:
            taken = np.diff(values) - np.diff(unwrapped)  # whole turns, or rounding
            jumps = np.flatnonzero(np.abs(taken) > 0.25 * np.abs(taken).max()) + 1
            self._count += len(jumps)
            self._times += [f"{t:.6g} s" for t in times[jumps[: SHOWN - len(self._times)]]]
        if self.offset:
            found = found + self.offset
        self._last = float(raw[-1])
        self.offset = float(found[-1] - raw[-1])
        return replace(channel, values=found)

    def warnings(self) -> list[str]:
        """One if there were wraps."""
        if not self._count:
            return []
        return [
            f"{self.file}: column {self.column!r}: {self.name} jumps by a turn at "
            f"{listed(self._times, self._count)}, and was unwrapped: check it"
        ]


@dataclass
class Still:
    """Stretches in which one position does not change while the other moves, across chunks.

    Parameters
    ----------
    file, name, column : str
        For messages.
    moves : float
        By how much the other one moves, in rad, to count as moving.
    """

    file: str
    name: str
    column: str
    moves: float
    _value: float = np.nan
    _since: float = np.nan
    _until: float = np.nan
    _lowest: float = np.inf  # of the other position since then
    _highest: float = -np.inf
    _times: list[str] = field(default_factory=list)
    _count: int = 0

    def look(self, values: FloatArray, other: FloatArray, time: FloatArray) -> None:
        """Look at one more chunk."""
        differs = values != self._value
        first = int(np.argmax(differs))
        if not differs[first]:
            self._go_on(other, float(time[-1]))
            return
        if first > 0:
            self._go_on(other[:first], float(time[first - 1]))
        self._close()
        for start, stop in self._inner(values, time):
            self._begin(start, stop, other, time)
            self._close()
        last = len(values) - int(np.argmax((values != values[-1])[::-1]))
        if last == len(values) and values[0] == values[-1]:
            last = first  # the whole chunk is alike
        self._begin(max(last, first), len(values), other, time)
        self._value = float(values[-1])

    def _inner(self, values: FloatArray, time: FloatArray) -> list[tuple[int, int]]:
        """Lasting stretches within a chunk, beginning and end.

        Most chunks have none, which a few samples show: a stretch that lasts holds two of them.
        """
        stride = max(1, int(0.4 * FROZEN * (len(time) - 1) / max(time[-1] - time[0], FROZEN)))
        few = values[::stride]
        if not (few[1:] == few[:-1]).any():
            return []
        edges = np.flatnonzero(np.diff(values)) + 1
        lasting = np.flatnonzero(time[edges[1:] - 1] - time[edges[:-1]] >= FROZEN)
        return [(int(edges[place]), int(edges[place + 1])) for place in lasting]

    def warnings(self) -> list[str]:
        """One if there were such stretches; to be asked at the end of the stream."""
        self._close()
        if not self._count:
            return []
        warning = (
            f"{self.file}: column {self.column!r}: {self.name} does not change from "
            f"{listed(self._times, self._count)}, while the other side moves: check the sensor, or "
            f"cut that stretch out"
        )
        return [Caution(warning, Rank.DATA)]

    def _begin(self, first: int, stop: int, other: FloatArray, time: FloatArray) -> None:
        self._since = float(time[first])
        self._lowest, self._highest = np.inf, -np.inf
        self._go_on(other[first:stop], float(time[stop - 1]))

    def _go_on(self, other: FloatArray, until: float) -> None:
        self._until = until
        self._lowest = min(self._lowest, float(other.min()))
        self._highest = max(self._highest, float(other.max()))

    def _close(self) -> None:
        """Count the stretch that ends, if it lasted and the other position moved in it."""
        if self._until - self._since >= FROZEN and self._highest - self._lowest > self.moves:
            self._count += 1
            if len(self._times) < SHOWN:
                self._times.append(f"{self._since:.6g} s to {self._until:.6g} s")


def listed(shown: list[str], count: int) -> str:
    """The first of some times, and how many more there are."""
    more = f" and {count - len(shown)} more times" if count > len(shown) else ""
    return ", ".join(shown) + more
