"""What a log holds once it is read: uniformly sampled recordings in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Literal, TypeAlias

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.models.motion import JointType
from flexid.recording.channel import Origin

Hold: TypeAlias = Literal["zero", "linear", "cubic"]
"""How an input behaves between samples: constant from each on, on straight lines, or smooth."""

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
        The motor's, at the link side of the gear; of a drive with one encoder, its position.
    input : FloatArray, shape (n,), or None
        What drives the motor, in `input_unit`; None where only positions were logged.
    input_unit : str
        ``"N m"`` or ``"N"``, ``"V"`` or ``"A"``; empty where there is no input.
    link_velocity, motor_velocity : FloatArray, shape (n,), or None
        Velocities in rad/s or m/s; None where they were not measured.
    source : str
        The file, as its path was given.
    link_from_deflection : bool
        Whether the link position is the motor's plus a measured deflection, which alone is late if
        it is.
    joint : str
        ``"revolute"``; ``"prismatic"`` where positions are in m.

    Raises
    ------
    RecordingError
        If the channels differ in length.
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

    def __post_init__(self) -> None:
        for name in CHANNELS:
            values = getattr(self, name)
            if values is not None and values.shape != (len(self),):
                raise RecordingError(
                    self.source or "recording",
                    name,
                    f"the channel has shape {values.shape} where the motor's position has "
                    f"{self.motor_position.shape}: give every channel one value per sample",
                )

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
    def time(self) -> FloatArray:
        """Time of every sample on the file's clock, shape (n,), in s."""
        return self.start_time + self.sample_time * np.arange(len(self), dtype=np.float64)

    @property
    def needed_link_position(self) -> FloatArray:
        """Link position, shape (n,)."""
        if self.link_position is None:
            raise RecordingError(
                self.source or "recording",
                "link_position",
                "the link's encoder is missing, and the compliance cannot be seen without it: log "
                "it, or identify the rigid joint",
            )
        return self.link_position

    @property
    def needed_input(self) -> FloatArray:
        """What drives the motor, shape (n,), in `input_unit`."""
        if self.input is None:
            raise RecordingError(
                self.source or "recording",
                "input",
                "no torque, current or voltage was logged, and nothing can be said of the motor "
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
            raise RecordingError(
                self.source or "recording",
                "",
                f"the window from sample {start_index} to {stop_index} does not lie within the "
                f"{len(self)} samples: choose 0 <= start < stop <= {len(self)}",
            )
        channels = {
            name: None
            if (values := getattr(self, name)) is None
            else values[start_index:stop_index]
            for name in CHANNELS
        }
        start = self.start_time + start_index * self.sample_time
        return replace(self, start_time=start, **channels)


@dataclass(frozen=True, eq=False)
class Log:
    """What one file held.

    Parameters
    ----------
    recordings : tuple of Recording
        One, or several where the file had gaps; all with the same sample time.
    warnings : tuple of str
        One sentence each, with the place and the remedy.
    source : str
        The file, as its path was given.
    sha256 : str
        Digest of the file's bytes.
    columns : mapping of str to Origin
        How each channel was computed from the columns of the file, by the channel's name.
    rests : bool
        Whether the motor stands still throughout, as one joint of an arm may.
    """

    recordings: tuple[Recording, ...]
    warnings: tuple[str, ...]
    source: str
    sha256: str
    columns: Mapping[str, Origin] = field(default_factory=dict)
    rests: bool = False

    def __repr__(self) -> str:
        recordings = ", ".join(
            f"{len(recording) * recording.sample_time:g} s" for recording in self.recordings
        )
        return f"<Log {self.source}: {recordings}>"

    @property
    def provenance(self) -> dict[str, object]:
        """File, digest and columns, as they stand in a result's JSON."""
        columns = {name: asdict(origin) for name, origin in self.columns.items()}
        return {"file": self.source, "sha256": self.sha256, "columns": columns}
