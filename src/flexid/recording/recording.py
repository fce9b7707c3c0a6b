"""Data types of logs: channels, drafts while a log is read, and uniformly sampled recordings.

Warnings have a rank, by which they are sorted in the order in which to act on them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import IntEnum
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.models.motion import JointType, unit_of


class Rank(IntEnum):
    """Subject of a warning. Correct the lowest first, since others may be its consequences."""

    DATA = 0  # samples are wrong, lost or left out
    SCALE = 1  # a unit, a scale, a sign or the wiring is wrong
    MODEL = 2  # the model lacks something that the drive has
    MOTION = 3  # the motion shows too little
    NOTE = 4  # an assumption or a correction


class Caution(str):
    """A warning: one sentence with its rank. A plain string counts as a note."""

    __slots__ = ("rank",)

    rank: Rank

    def __new__(cls, text: str, rank: Rank = Rank.NOTE) -> Caution:
        """Return the sentence with its rank."""
        made = super().__new__(cls, text)
        made.rank = rank
        return made


def cautions(rank: Rank, texts: Iterable[str]) -> tuple[Caution, ...]:
    """Return texts as warnings of a rank; texts with a rank keep it."""
    return tuple(text if isinstance(text, Caution) else Caution(text, rank) for text in texts)


def rank_of(text: str) -> Rank:
    """Return the rank of a warning."""
    return text.rank if isinstance(text, Caution) else Rank.NOTE


def ranked(texts: Iterable[str]) -> tuple[str, ...]:
    """Return each warning once, in the order of the ranks; equal ranks keep their order."""
    return tuple(sorted(dict.fromkeys(texts), key=rank_of))


LARGEST_FILE = 500_000_000  # bytes, of a file read at once; it takes about four times the memory
MOST_ROWS = 5_000_000  # an identification in memory takes 2 kB for each
MOST_COLUMNS = 10_000
MOST_CELLS = 100_000_000  # limited, since a small file may have any number of empty or equal cells
LONGEST_SAMPLE_TIME = 0.5  # s
SHORTEST_SAMPLE_TIME = 1e-6  # s


def check_cells(file: str, rows: int, columns: int) -> None:
    """Raise if a table of this size would not fit into memory."""
    if columns > MOST_COLUMNS or rows * columns > MOST_CELLS:
        raise RecordingError(
            file,
            "",
            f"there are {columns} columns of {rows} rows, more than are read at once: write the "
            f"columns of one joint",
        )


ENCODERS = ("link_position", "motor_position")
POSITIONS = (*ENCODERS, "deflection")
VELOCITIES = ("link_velocity", "motor_velocity")
INPUTS = ("motor_torque", "motor_current", "motor_voltage")  # in the order of preference
SI_UNITS: dict[str, tuple[str, ...]] = {  # of a revolute joint
    "time": ("s",),
    "link_position": ("rad",),
    "link_velocity": ("rad/s",),
    "motor_position": ("rad",),
    "motor_velocity": ("rad/s",),
    "deflection": ("rad",),
    "motor_torque": ("N m", "V", "A"),
    "motor_current": ("A",),
    "motor_voltage": ("V", "N m"),
}
# Channels that the gear ratio converts: angles are divided by it, torques are multiplied.
GEARED = ("motor_position", "motor_velocity", "motor_torque", "motor_voltage")


def si_units(name: str, joint: JointType) -> tuple[str, ...]:
    """Return the SI units of a channel; the first one applies to columns without a unit."""
    return tuple(unit_of(unit, joint) for unit in SI_UNITS[name])


@dataclass(frozen=True)
class Origin:
    """How a channel was computed: ``factor * (sum of weight * column) + offset``, in SI units."""

    columns: Mapping[str, float]  # weights of the columns, by name in the file
    factor: float  # product of the unit's factor, the scale of a column map and the gear ratio
    offset: float  # in `unit`
    unit: str  # SI
    # turns of the motor per turn of the link, or its rad per m, by which `factor` converts the
    # channel to the link's side of the gear or screw
    ratio: float | None


@dataclass(frozen=True, eq=False)
class Channel:
    """One canonical channel of a file, in SI units."""

    values: FloatArray  # shape (n,)
    column: str  # its name in the file; several are joined by " + "
    unit_stated: bool  # whether the file or the map named a unit
    origin: Origin

    @property
    def unit(self) -> str:
        """SI unit of the values."""
        return self.origin.unit

    @property
    def joint(self) -> JointType:
        """Type of the joint, if the channel is a position."""
        return "prismatic" if self.unit == unit_of("rad", "prismatic") else "revolute"

    @property
    def place(self) -> str:
        """The column, for a message."""
        return f"column {self.column!r}"


@dataclass(eq=False)
class Draft:
    """A log that is being checked and corrected."""

    file: str
    channels: dict[str, Channel]  # with the time
    number: str = ""  # of the joint, as in _2; empty if there is only one
    warnings: list[str] = field(default_factory=list)
    # samples after which another recording begins, though no time is missing
    seams: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    restarts: tuple[float, ...] = ()  # times after which the time in the file restarts, in s

    def __getitem__(self, name: str) -> FloatArray:
        return self.channels[name].values

    def __setitem__(self, name: str, values: FloatArray) -> None:
        self.channels[name] = replace(self.channels[name], values=values)

    @property
    def time(self) -> FloatArray:
        """Time stamps in s."""
        return self["time"]

    @property
    def names(self) -> list[str]:
        """Names of the channels except the time."""
        return [name for name in self.channels if name != "time"]

    @property
    def joint(self) -> JointType:
        """Type of the joint."""
        return self.channels["motor_position"].joint

    @property
    def ratio(self) -> str:
        """Name of the ratio of motor and link, for messages."""
        return "gear ratio" if self.joint == "revolute" else "lead"

    def those_of(self, names: Iterable[str]) -> list[str]:
        """Return those of some names that are channels of the log."""
        return [name for name in names if name in self.channels]

    def at(self, places: Any) -> str:
        """Return times of samples for a message: the first three, and how many more there are."""
        shown = [f"{time:.6g} s" for time in self.time[places[:_MOST_TIMES]]]
        return _first_times(shown, len(places))

    def spans(self, ends: Iterable[tuple[int, int]]) -> str:
        """Return time spans between samples for a message: the first three, and how many more."""
        spans = [f"{self.time[a]:.6g} s to {self.time[b]:.6g} s" for a, b in ends]
        return _first_times(spans, len(spans))

    def warn(self, names: str | Sequence[str], what: str, rank: Rank = Rank.NOTE) -> None:
        """Add a warning about one channel, several, or the whole log (no name)."""
        parts = (self.file, place, what) if (place := self._place(names)) else (self.file, what)
        self.warnings.append(Caution(": ".join(parts), rank))

    def refusal(self, names: str | Sequence[str], reason: str) -> RecordingError:
        """Return the error that refuses the log, with one channel, several or none as place."""
        return RecordingError(self.file, self._place(names), reason)

    def _place(self, names: str | Sequence[str]) -> str:
        """Columns of channels, for a message; a name that is no channel is returned as it is."""
        if isinstance(names, str):
            return self.channels[names].place if names in self.channels else names
        columns = [repr(self.channels[name].column) for name in names]
        return f"columns {' and '.join(columns)}"

    def keep(self, kept: np.ndarray) -> None:
        """Keep only samples by a mask of shape (n,)."""
        for name in self.channels:
            self[name] = self[name][kept]


_MOST_TIMES = 3  # in a message


def _first_times(times: list[str], count: int) -> str:
    """The first three times, and how many more there are of `count`."""
    more = f" and {count - _MOST_TIMES} more times" if count > _MOST_TIMES else ""
    return ", ".join(times[:_MOST_TIMES]) + more


Hold: TypeAlias = Literal["zero", "linear", "cubic"]
"""Course of an input between samples: constant until the next, straight lines, or cubic."""

CHANNELS = ("link_position", "motor_position", "input", "link_velocity", "motor_velocity")


@dataclass(frozen=True, eq=False)
class Recording:
    """One contiguous, uniformly sampled recording of a log, in SI units.

    Parameters
    ----------
    sample_time : float
        Time between samples in s.
    start_time : float
        Time of the first sample on the file's own clock in s.
    link_position : FloatArray, shape (n,), or None
        Link angle in rad; None where only one encoder was logged. Of a prismatic joint in m.
    motor_position : FloatArray, shape (n,)
        Motor angle at the link side of the gear; with one encoder, the position of the drive.
    input : FloatArray, shape (n,), or None
        Torque, force, current or voltage in `input_unit`; None where only positions were logged.
    input_unit : str
        ``"N m"`` or ``"N"``, ``"V"`` or ``"A"``; empty where there is no input.
    link_velocity, motor_velocity : FloatArray, shape (n,), or None
        Velocities in rad/s or m/s; None where they were not measured.
    source : str
        The file, as its path was given.
    link_from_deflection : bool
        Whether the link position is the motor position plus a measured deflection. A delay of the
        link then applies to the deflection alone.
    joint : str
        ``"revolute"``; ``"prismatic"`` where positions are in m.
    from_voltage : bool
        Whether an input that is no voltage was computed from one, as a torque is by a known gain.

    Raises
    ------
    RecordingError
        If the channels differ in length, or if a value is not finite.
    """

    sample_time: float
    start_time: float
    link_position: FloatArray | None
    motor_position: FloatArray
    input: FloatArray | None
    input_unit: str
    link_velocity: FloatArray | None = None
    motor_velocity: FloatArray | None = None
    source: str = ""
    link_from_deflection: bool = False
    joint: JointType = "revolute"
    from_voltage: bool = False

    def __post_init__(self) -> None:
        for name in CHANNELS:
            values = getattr(self, name)
            if values is not None and values.shape != (len(self),):
                raise self._refusal(
                    name,
                    f"the channel has shape {values.shape} where the motor's position has "
                    f"{self.motor_position.shape}: give every channel one value per sample",
                )
            if values is not None and not np.isfinite(values).all():
                reason = "a value is not finite: remove that sample, or read the arrays by read_log"
                raise self._refusal(name, reason)

    def __len__(self) -> int:
        return int(self.motor_position.shape[0])

    def __repr__(self) -> str:
        units = {"input": f"input ({self.input_unit})"}
        there = [units.get(c, c) for c in CHANNELS if getattr(self, c) is not None]
        return (
            f"<Recording of {self.source or 'arrays'}: {len(self)} samples every "
            f"{self.sample_time:g} s, {', '.join(there)}>"
        )

    @property
    def clamped(self) -> frozenset[str]:
        """Positions that are constant, as a column map states for a clamped side."""
        positions = {name: getattr(self, name) for name in ENCODERS}
        return frozenset(n for n, own in positions.items() if own is not None and not np.ptp(own))

    @property
    def time(self) -> FloatArray:
        """Time of every sample on the file's clock, shape (n,), in s."""
        return self.start_time + self.sample_time * np.arange(len(self), dtype=np.float64)

    @property
    def needed_link_position(self) -> FloatArray:
        """Link position, shape (n,); raise if it was not logged."""
        if self.link_position is None:
            raise self._refusal(
                "link_position",
                "the link's encoder is missing, without which the compliance cannot be seen: log "
                "it, or identify the rigid joint",
            )
        return self.link_position

    @property
    def needed_input(self) -> FloatArray:
        """Input of the motor, shape (n,), in `input_unit`; raise if it was not logged."""
        if self.input is None:
            raise self._refusal(
                "input",
                "no torque, current or voltage was logged, and the motor cannot be identified "
                "without it: log it, or identify the link alone",
            )
        return self.input

    @property
    def deflection(self) -> FloatArray:
        """Link position minus motor position, shape (n,)."""
        return self.needed_link_position - self.motor_position

    def window(self, start_index: int, stop_index: int) -> Recording:
        """Return the samples from `start_index` up to, not including, `stop_index`.

        Parameters
        ----------
        start_index, stop_index : int
            Ends of the window, in samples.
        """
        if not 0 <= start_index < stop_index <= len(self):
            raise self._refusal(
                "",
                f"the window from sample {start_index} to {stop_index} does not lie within the "
                f"{len(self)} samples: choose 0 <= start < stop <= {len(self)}",
            )
        there = {name: own for name in CHANNELS if (own := getattr(self, name)) is not None}
        channels = {name: own[start_index:stop_index] for name, own in there.items()}
        start = self.start_time + start_index * self.sample_time
        return replace(self, start_time=start, **channels)

    def _refusal(self, place: str, reason: str) -> RecordingError:
        return RecordingError(self.source or "recording", place, reason)


@dataclass(frozen=True, eq=False)
class Log:
    """Content of one log file.

    Parameters
    ----------
    recordings : tuple of Recording
        One or several, separated by gaps of the file, with the same sample time.
    warnings : tuple of str
        One sentence each, with the place and the remedy.
    source : str
        The file, as its path was given.
    sha256 : str
        Digest of the file's bytes.
    columns : mapping of str to Origin
        How each channel was computed from the columns of the file, by the channel's name.
    rests : bool
        Whether the motor rests throughout the log, as one joint of an arm may.
    turned : tuple of str
        Channels whose sign was changed, because the mechanics contradict it as logged.
    """

    recordings: tuple[Recording, ...]
    warnings: tuple[str, ...]
    source: str
    sha256: str
    columns: Mapping[str, Origin] = field(default_factory=dict)
    rests: bool = False
    turned: tuple[str, ...] = ()

    def __repr__(self) -> str:
        recordings = ", ".join(
            f"{len(recording) * recording.sample_time:g} s" for recording in self.recordings
        )
        return f"<Log {self.source}: {recordings}>"

    @property
    def provenance(self) -> dict[str, object]:
        """File, digest and columns, for the JSON of a result."""
        columns = {name: asdict(origin) for name, origin in self.columns.items()}
        return {"file": self.source, "sha256": self.sha256, "columns": columns}
