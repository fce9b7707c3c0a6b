"""Which of a stream's channels are learnt from: time, one or two encoders, and the input."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from flexid.errors import RecordingError
from flexid.identification.preparation.joint import Kind
from flexid.recording.channel import INPUTS, Channel
from flexid.recording.wraps import TURN


@dataclass(frozen=True)
class StreamChannels:
    """What the values of a sample are."""

    kind: Kind  # whether there are two encoders and an input, no input, or one encoder
    input_unit: str  # of the input; empty where there is none
    from_deflection: bool  # whether the first position is the joint's deflection
    warnings: tuple[str, ...]  # what was assumed
    motor_turn: float = 0.0  # see `WatchOptions`
    # by name and in a sample's order, with the values of the first samples
    sampled: Mapping[str, Channel] = field(default_factory=dict, compare=False)

    @property
    def words(self) -> str:
        """The channels, for a message."""
        link = "deflection, " if self.from_deflection else "link position, "
        positions = (link if self.kind != "rigid" else "") + "motor position"
        return positions + (f" and an input in {self.input_unit}" if self.input_unit else "")


def chosen_channels(
    source: str, channels: Mapping[str, Channel], warnings: tuple[str, ...], model: str = "auto"
) -> tuple[list[str], StreamChannels]:
    """The names of a sample's channels, in its order: time, positions, input; what they are."""
    drive = next((name for name in INPUTS if name in channels), None)
    link = next((name for name in ("deflection", "link_position") if name in channels), None)
    kind = model
    if model == "auto":
        kind = "rigid" if link is None else "link" if drive is None else "flexible"
    if kind != "link" and drive is None:
        raise RecordingError(
            source,
            "input",
            "no torque, current or voltage is among the columns, and nothing can be learnt of the "
            "motor without it: send it too",
        )
    if kind != "rigid" and link is None:
        raise RecordingError(
            source, "link position", "is not among the columns: send it too, or --model rigid"
        )
    names = ["time", "" if kind == "rigid" else link, "motor_position"]
    names += [drive] * (kind != "link")
    unit = channels[drive].unit if drive is not None and kind != "link" else ""
    from_deflection = kind != "rigid" and link == "deflection"
    gear = channels["motor_position"].origin.gear_ratio
    turn = TURN / abs(gear) if gear else 0.0
    names = [name for name in names if name]
    sampled = {name: channels[name] for name in names}
    meant = StreamChannels(
        kind,  # type: ignore[arg-type]
        unit,
        from_deflection,
        warnings,
        turn,
        sampled,
    )
    return names, meant
