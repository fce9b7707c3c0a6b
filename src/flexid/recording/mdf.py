"""MDF files of measurement and calibration tools, versions 2 to 4: through asammdf, apart."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from flexid.errors import RecordingError
from flexid.files import shown
from flexid.recording.one_clock import values_around
from flexid.recording.outside import digest_of, need
from flexid.recording.series import Series, SeriesFile

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator, Mapping
    from pathlib import Path

    from flexid.arrays import FloatArray

    Range: TypeAlias = tuple[int, int]  # the first of some records, from 0, and how many they are

PROGRAM = "from flexid.recording.mdf_apart import main; main()"


def open_series(path: Path) -> SeriesFile:
    """The signals of an MDF file, each on the clock of its group.

    asammdf reads it in a process of its own, since a damaged file can end that process.

    Raises
    ------
    RecordingError
        If it is no MDF file, a damaged one, or asammdf is not installed.
    """
    file = shown(path)
    digest = digest_of(path)
    need(file, "asammdf", "mdf")
    apart = _Apart(file, path)
    held = apart.answer()
    channels, others = held["series"], held["others"]
    names = Counter(channel["name"] for channel in channels)
    series: dict[str, Series] = {}
    places: dict[str, tuple[int, int]] = {}
    values: dict[str, FloatArray] = {}
    for channel in channels:
        name, where = channel["name"], channel["where"]
        if names[name] > 1:
            name = f"{where}/{name}"
        if name in series:
            name = f"{where}/{channel['index']}/{channel['name']}"
        series[name] = Series(
            name, "number", channel["length"], _kept(values, name), channel["unit"], where
        )
        places[name] = channel["group"], channel["index"]
    groups = {one.clock: places[name][0] for name, one in series.items()}

    lengths = {one.clock: one.length for one in series.values()}

    def read(chosen: Collection[Series], ranges: Mapping[str, Range]) -> None:
        """Records of each group from the first to the last of a range."""
        paths = [one.path for one in chosen]
        channels = [(*places[one.path], *ranges[one.clock]) for one in chosen]
        read = apart.arrays(channels, [(groups[name], *own) for name, own in ranges.items()])
        values.update(zip([*paths, *map(_clock, ranges)], read, strict=True))

    def prepare(chosen: Collection[Series]) -> None:
        read(chosen, {one.clock: (0, lengths[one.clock]) for one in chosen})

    def parts(chosen: Collection[Series], size: int) -> Iterator[tuple[float, float]]:
        clocks = {one.clock: lengths[one.clock] for one in chosen}
        if len(clocks) == 1:
            ((clock, length),) = clocks.items()
            for first in range(0, length, size):
                read(chosen, {clock: (first, min(size, length - first))})
                yield -np.inf, np.inf
            return
        stamps = apart.arrays([], [(groups[name], 0, length) for name, length in clocks.items()])
        for begin, end, ranges in _ranges(dict(zip(clocks, stamps, strict=True)), size):
            read(chosen, ranges)
            yield begin, end

    return SeriesFile(
        file,
        digest,
        tuple(series.values()),
        others,
        {name: _kept(values, _clock(name)) for name in groups},
        prepare=prepare,
        parts=parts,
        close=apart.close,
    )


def _ranges(
    stamps: Mapping[str, FloatArray], size: int
) -> Iterator[tuple[float, float, dict[str, Range]]]:
    """Parts of about so many records of the fastest clock: from when to when, and which records."""
    around = values_around(stamps)
    # Where a clock runs backwards the part is refused in which it does.
    ordered = {name: np.maximum.accumulate(times) for name, times in stamps.items()}
    fastest = max(ordered.values(), key=len)
    begin = -np.inf
    for end in [*fastest[size - 1 : -1 : size].tolist(), np.inf]:
        ranges = {}
        for name, times in ordered.items():
            first = max(0, int(np.searchsorted(times, begin, "right")) - around[name])
            last = min(len(times), int(np.searchsorted(times, end, "right")) + around[name])
            ranges[name] = (first, last - first)
        yield begin, end, ranges
        begin = end


def _clock(group: str) -> str:
    return f"the clock of {group}"


def _kept(values: dict[str, FloatArray], name: str) -> Callable[[], FloatArray]:
    return lambda: values[name]


class _Apart:
    """A process that reads one file."""

    def __init__(self, file: str, path: Path) -> None:
        self._file = file
        paths = os.pathsep.join(entry for entry in sys.path if entry)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", PROGRAM, str(path)],  # -P: nothing of the log's folder
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": paths},
        )  # fmt: skip

    def answer(self) -> dict[str, Any]:
        """The next line; raise if the process has ended, or refuses."""
        line = self._out.readline()
        try:
            found = json.loads(line)
        except ValueError:  # of a process that ended there is none, or a part
            raise self._unreadable() from None
        if "refused" in found:
            self.close()
            raise RecordingError(self._file, *found["refused"])
        return found

    def arrays(
        self, channels: list[tuple[int, int, int, int]], clocks: list[tuple[int, int, int]]
    ) -> list[FloatArray]:
        """Values of channels, by group and index, and time stamps of groups, each of a range."""
        assert self._process.stdin is not None
        asked = json.dumps({"channels": channels, "clocks": clocks})
        try:
            self._process.stdin.write(asked.encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            raise self._unreadable() from None
        found = []
        for length in self.answer()["lengths"]:
            raw = self._out.read(8 * length)
            if len(raw) < 8 * length:
                raise self._unreadable()
            found.append(np.frombuffer(raw, dtype="<f8").astype(np.float64))
        return found

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    @property
    def _out(self) -> Any:
        return self._process.stdout

    def _unreadable(self) -> RecordingError:
        self.close()
        return RecordingError(
            self._file, "", "this is no MDF file that can be read: export or copy it again"
        )
