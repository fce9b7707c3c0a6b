"""A log while it is read: its channels, and what was found of them so far."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording.caution import Caution, Rank
from flexid.recording.channel import Channel
from flexid.recording.names import MOST_TIMES, first_times

ENCODERS = ("link_position", "motor_position")
POSITIONS = (*ENCODERS, "deflection")


@dataclass(eq=False)
class Draft:
    """A log that is checked and mended step by step."""

    file: str
    channels: dict[str, Channel]  # without the time
    time: Channel
    warnings: list[str] = field(default_factory=list)
    uncounted: tuple[int, ...] = ()  # as in `Log`

    def __getitem__(self, name: str) -> FloatArray:
        return self.channels[name].values

    def __setitem__(self, name: str, values: FloatArray) -> None:
        self.channels[name] = replace(self.channels[name], values=values)

    def set_time(self, values: FloatArray) -> None:
        """Take other times in s."""
        self.time = replace(self.time, values=values)

    def those_of(self, names: Iterable[str]) -> list[str]:
        """The channels of some that there are."""
        return [name for name in names if name in self.channels]

    def columns(self, names: Iterable[str]) -> str:
        """The columns of some channels, for a message."""
        return "columns " + " and ".join(repr(self.channels[name].column) for name in names)

    def at(self, places: Any) -> str:
        """Times of some samples, for a message: the first three, and how many more there are."""
        shown = [f"{time:.6g} s" for time in self.time.values[places[:MOST_TIMES]]]
        return first_times(shown, len(places))

    def warn(self, place: str, what: str, rank: Rank = Rank.NOTE) -> None:
        """Note a warning: place and sentence."""
        parts = (self.file, place, what) if place else (self.file, what)
        self.warnings.append(Caution(": ".join(parts), rank))

    def refusal(self, place: str, reason: str) -> RecordingError:
        """The error by which the log is refused."""
        return RecordingError(self.file, place, reason)

    def keep(self, kept: np.ndarray) -> None:
        """Leave all samples out but these."""
        for name in self.channels:
            self[name] = self[name][kept]
        self.set_time(self.time.values[kept])
