"""What a log shows at a glance, before anything is fitted to it."""

from dataclasses import dataclass

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.recording import CHANNELS, Log, Recording
from flexid.recording.sampling import FEWEST_TO_IDENTIFY
from flexid.recording.velocities import position_noise, velocity

_RESTING = 0.02  # of the largest velocity
_SHARE = 0.95  # of the input's power
_FEW_REVERSALS = 4
_SMALL_DEFLECTION = 3.0  # times the encoders' noise


@dataclass(frozen=True)
class ChannelSurvey:
    """One channel of a log."""

    name: str
    unit: str  # SI
    lowest: float
    highest: float
    noise: float  # standard deviation of an encoder's noise in rad; else NaN


@dataclass(frozen=True)
class LogSurvey:
    """What a log shows at a glance."""

    model: str  # "flexible", "link" or "rigid": what can be identified of it
    sample_time: float  # s
    duration: float  # s, without gaps
    samples: int
    recordings: int  # between gaps
    channels: tuple[ChannelSurvey, ...]  # in the order of reading
    reversals: int  # how often the motor turns back
    resting: float  # share of the time in which it rests
    deflection_over_noise: float  # RMS about the mean, over the encoders' noise; NaN with one
    input_bandwidth: float  # Hz, below which 95 % of the input's power lies; NaN without an input
    remarks: tuple[str, ...]  # what stands against a good answer


def survey(log: Log) -> LogSurvey:
    """What a log shows at a glance."""
    longest = max(log.recordings, key=len)
    reversals, resting = _motion(log.recordings)
    deflection = _deflection_over_noise(longest)
    remarks = []
    if len(longest) < FEWEST_TO_IDENTIFY:
        remarks.append(
            f"The longest stretch has {len(longest)} samples where {FEWEST_TO_IDENTIFY} are the "
            f"fewest that can be identified: record for longer."
        )
    if reversals < _FEW_REVERSALS:
        remarks.append(
            f"The motor turns back {reversals} time{'s' if reversals != 1 else ''}, and "
            f"friction shows where it does: let it move to and fro."
        )
    if deflection < _SMALL_DEFLECTION:
        remarks.append(
            f"The deflection is {deflection:.2g} times its encoders' noise, so the stiffness may "
            f"not show: drive the joint harder, or near its resonance."
        )
    return LogSurvey(
        _model(longest),
        longest.sample_time,
        sum(len(recording) for recording in log.recordings) * longest.sample_time,
        sum(len(recording) for recording in log.recordings),
        len(log.recordings),
        tuple(_channels(log.recordings)),
        reversals,
        resting,
        deflection,
        _bandwidth(longest),
        tuple(remarks),
    )


def _model(recording: Recording) -> str:
    if recording.link_position is None:
        return "rigid"
    return "link" if recording.input is None else "flexible"


def _channels(recordings: tuple[Recording, ...]) -> list[ChannelSurvey]:
    found = []
    units = {"input": recordings[0].input_unit}
    for name in CHANNELS:
        parts = [getattr(recording, name) for recording in recordings]
        if parts[0] is None:
            continue
        is_position = name.endswith("position")
        noise = position_noise(max(parts, key=len)) if is_position else np.nan
        unit = units.get(name, "rad" if is_position else "rad/s")
        lowest, highest = min(p.min() for p in parts), max(p.max() for p in parts)
        found.append(ChannelSurvey(name, unit, float(lowest), float(highest), noise))
    return found


def _motion(recordings: tuple[Recording, ...]) -> tuple[int, float]:
    """How often the motor turns back, and the share of the time in which it rests."""
    velocities = [velocity(r.motor_position, r.sample_time) for r in recordings]
    slow = _RESTING * max(float(np.abs(v).max()) for v in velocities)
    moving = [np.sign(v[np.abs(v) > slow]) for v in velocities]
    turned = sum(int(np.count_nonzero(np.diff(signs))) for signs in moving)
    return turned, 1.0 - sum(map(len, moving)) / sum(map(len, velocities))


def _deflection_over_noise(recording: Recording) -> float:
    if recording.link_position is None:
        return float("nan")
    noise = position_noise(recording.deflection)
    moved = float(recording.deflection.std())
    return moved / noise if noise > 0.0 else float("inf")


def _bandwidth(recording: Recording) -> float:
    if recording.input is None:
        return float("nan")
    power: FloatArray = np.abs(np.fft.rfft(recording.input - recording.input.mean())) ** 2
    frequencies = np.fft.rfftfreq(len(recording), recording.sample_time)
    total = np.cumsum(power)
    return float(frequencies[np.searchsorted(total, _SHARE * total[-1])])
