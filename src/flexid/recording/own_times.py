"""Arrays of a file that stand beside times of their own, as a simulation or a rig saves signals."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING

from flexid.errors import RecordingError
from flexid.readers.contents import STAMPS, Series
from flexid.readers.guard import Reading
from flexid.recording.names import quoted, usual_channel
from flexid.recording.units import UnitError, scale_to_si

if TYPE_CHECKING:
    import polars


class OwnTimes:
    """A file of arrays that each have the times nearest to them: signals with clocks."""

    def __init__(self, reading: Reading, times: Mapping[str, str]) -> None:
        self.file, self.sha256, self.format = reading.file, reading.sha256, reading.format
        self.notes, self.is_table = reading.notes, False
        self._reading = reading
        self._times = {one.path: one for one in reading.series if one.path in times.values()}
        own = [
            one._replace(clock=nearest(one.path, times))
            for one in reading.series
            if one.path not in self._times
        ]
        self.series = [one for one in own if one.clock]
        timeless = {one.path: "no time stands beside it" for one in own if not one.clock}
        self.others = {**reading.others, **timeless}

    def frames(self, paths: Collection[str], size: int) -> Iterator[tuple[str, polars.DataFrame]]:
        """Values of some signals with their times, clock by clock."""
        import polars as pl

        chosen: dict[str, list[str]] = {}
        for one in self.series:
            if one.path in paths:
                if one.length != self._times[one.clock].length:
                    raise other_length(self.file, one, self._times[one.clock])
                chosen.setdefault(one.clock, []).append(one.path)
        dated = {clock for clock in chosen if self._times[clock].kind.startswith("datetime")}
        if dated and dated != {*chosen}:
            raise RecordingError(
                self.file,
                f"{quoted(chosen)}",
                "some hold dates and the others numbers or durations: give all of them one clock",
            )
        for clock, own in chosen.items():
            for _, frame in self._reading.frames([clock, *own], size):
                stamps = frame[clock]
                if clock in dated:
                    stamps = stamps.cast(pl.Datetime("ns")).to_physical()
                elif stamps.dtype.is_temporal():
                    stamps = 1e-9 * stamps.cast(pl.Duration("ns")).to_physical()
                else:
                    stamps = stamps.cast(pl.Float64) * self._unit(clock)
                yield clock, frame.drop(clock).with_columns(stamps.alias(STAMPS))

    def _unit(self, clock: str) -> float:
        """One unit of a clock of numbers in s."""
        usual = usual_channel(split_path(header_of(self._times[clock]))[1])
        try:
            return scale_to_si((usual.unit if usual else None) or "s", ("s",))[0]
        except UnitError as error:
            raise RecordingError(self.file, f"{clock!r}", str(error)) from None


def header_of(series: Series) -> str:
    """Its path, with the unit in brackets."""
    return f"{series.path} [{series.unit}]" if series.unit else series.path


def times_beside(series: Iterable[Series]) -> dict[str, str]:
    """By the path of what they stand in, the arrays of times; empty where there are several."""
    found: dict[str, list[str]] = {}
    for one in series:
        folder, name = split_path(one.path)
        usual = usual_channel(name)
        if usual is not None and usual.channel == "time":
            found.setdefault(folder, []).append(one.path)
    return {folder: paths[0] if len(paths) == 1 else "" for folder, paths in found.items()}


def nearest(path: str, times: Mapping[str, str]) -> str:
    """The array of times that stands nearest to another array; empty where it is not clear."""
    folder = path
    while folder:
        folder, _ = split_path(folder)
        if folder in times:
            return times[folder]
    return ""


def split_path(path: str) -> tuple[str, str]:
    """The path of what an array stands in, and its own name."""
    at = max(path.rfind("/"), path.rfind("."))
    return (path[:at], path[at + 1 :]) if at >= 0 else ("", path)


def other_length(file: str, one: Series, time: Series) -> RecordingError:
    """What is said of an array that is longer or shorter than its times."""
    return RecordingError(
        file,
        f"{one.path!r}",
        f"it has {one.length} values where {time.path!r} has {time.length}: bring the two to one "
        f"clock, and save them at one length",
    )
