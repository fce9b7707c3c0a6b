"""Which of a stream's channels are learnt from: time, one or two encoders, and the input."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from flexid.errors import RecordingError
from flexid.recording.channel import INPUTS, Channel


@dataclass(frozen=True)
class StreamChannels:
    """What the values of a sample are.

    Parameters
    ----------
    kind : {"flexible", "rigid"}
        Whether there are two encoders or one.
    input_unit : str
        Of the input.
    from_deflection : bool
        Whether the first position is the joint's deflection.
    warnings : tuple of str
        What was assumed.
    """

    kind: Literal["flexible", "rigid"]
    input_unit: str
    from_deflection: bool
    warnings: tuple[str, ...]

    @property
    def words(self) -> str:
        """The channels, for a message."""
        link = "deflection, " if self.from_deflection else "link position, "
        positions = (link if self.kind == "flexible" else "") + "motor position"
        return f"{positions} and an input in {self.input_unit}"


def chosen_channels(
    source: str, channels: Mapping[str, Channel], warnings: tuple[str, ...]
) -> tuple[list[Channel], StreamChannels]:
    """The channels of a sample, in its order: time, positions, input.

    Parameters
    ----------
    source : str
        For messages.
    channels : mapping of str to Channel
        As of a log, by name.
    warnings : tuple of str
        What was assumed of them.

    Raises
    ------
    RecordingError
        If there is no input.
    """
    drive = next((name for name in INPUTS if name in channels), None)
    if drive is None:
        raise RecordingError(
            source,
            "input",
            "no torque, current or voltage is among the columns, and nothing can be learnt of the "
            "motor without it: send it too",
        )
    link = next((name for name in ("deflection", "link_position") if name in channels), None)
    positions = ["motor_position"] if link is None else [link, "motor_position"]
    chosen = [channels[name] for name in ("time", *positions, drive)]
    kind = "rigid" if link is None else "flexible"
    return chosen, StreamChannels(kind, channels[drive].unit, link == "deflection", warnings)
