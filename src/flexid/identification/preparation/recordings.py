"""Preparation of logs: recordings of motion, each with a held-out end; alignment of channels."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, hypot
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError, SettingError
from flexid.estimators.channel_timing import after_a_lag, before_a_lag, invalid_ends, later
from flexid.identification.preparation.joint import Kind
from flexid.identification.preparation.settings import Auto
from flexid.models.motion import JointType, unit_of
from flexid.recording.recording import Caution, Hold, Log, Rank, Recording
from flexid.recording.velocities import (
    is_noise,
    position_noise,
    velocity,
    while_free,
    while_moving,
    with_velocities,
)

_FEWEST_TRAINING_SAMPLES = 50
_FEWEST_HELD_OUT_SAMPLES = 10
# Share of a log's samples in its shortest recordings, which are left out. They add little, but the
# shortest recording limits the band of a fit and the delays that it can find.
_SHORTEST = 0.03
# Number of windows of a long log in which the structure is sought. More windows show no further
# term that matters, and the search makes some 200 passes over them.
_WINDOWS = 3
_LONG_ENOUGH, _SLOW_ENOUGH = 10_000, 3.0  # samples, and seconds, of such a window


@dataclass(frozen=True)
class SplitRecordings:
    """Recordings of motion without gaps, each split into a part to fit and a held-out end."""

    recorded: tuple[Recording, ...]  # as recorded
    starts: tuple[int, ...]  # index of the first held-out sample of each recording
    groups: tuple[int, ...]  # index of each recording's log

    @cached_property
    def whole(self) -> tuple[Recording, ...]:
        """Whole recordings, with velocities."""
        return tuple(with_velocities(recording) for recording in self.recorded)

    @cached_property
    def searched(self) -> tuple[tuple[Recording, ...], tuple[int, ...]]:
        """Parts before the held-out ends that are searched for terms, and the log of each.

        Short logs are searched as a whole, long ones in windows. Velocities are derived from each
        part alone, without held-out positions.
        """
        parts = [
            (group, with_velocities(recording.window(first, stop)))
            for recording, start, group in zip(self.recorded, self.starts, self.groups, strict=True)
            for first, stop in self._windows(recording.sample_time, start)
        ]
        groups, recordings = zip(*parts, strict=True)
        return recordings, groups

    def _windows(self, sample_time: float, count: int) -> Iterator[tuple[int, int]]:
        """Yield evenly spread windows of a recording's first `count` samples, or all of these."""
        length = max(_LONG_ENOUGH, ceil(_SLOW_ENOUGH / sample_time))
        share = min(1.0, _WINDOWS * length / sum(self.starts))
        number = max(1, round(share * count / length))
        if share * count > count - number:
            number = 1
        own = int(share * count / number)
        for first in np.linspace(0, count - own, number).astype(int).tolist():
            yield first, first + own


MEMORY = 4096
"""Samples after which an input no longer acts through a lag: eight times 40 ms at 10 kHz."""


@dataclass(frozen=True)
class Amplifier:
    """Amplifier, and filters between the drive and its log; ideal by default."""

    dead_zone: float = 0.0  # in the input's unit
    limit: float | None = None  # largest output, in the input's unit; None for no limit
    log_lag: float = 0.0  # time constant in s of a first-order filter before the log
    lag: float = 0.0  # time constant in s of its own response, of first order
    # time constants in s of first-order filters of an encoder, or of a deflection, before the log
    link_lag: float = 0.0
    motor_lag: float = 0.0

    @property
    def corrects(self) -> bool:
        """Whether the amplifier differs from an ideal one."""
        return self != IDEAL

    @property
    def filters_positions(self) -> bool:
        """Whether an encoder was filtered before the log."""
        return bool(self.link_lag or self.motor_lag)

    def passed(self, commanded: FloatArray) -> FloatArray:
        """Return the amplifier's output for a commanded input."""
        limited = commanded
        if self.limit is not None:
            limited = np.clip(commanded, -self.limit, self.limit)
        return limited - np.clip(limited, -self.dead_zone, self.dead_zone)

    def reached(
        self, logged: FloatArray, sample_time: float, earlier: FloatArray | None = None
    ) -> FloatArray:
        """Return the input after the amplifier, shape (n,).

        `earlier` samples precede it, at best `MEMORY` or more; without them it was constant before.
        """
        whole = logged if earlier is None else np.concatenate((earlier, logged))
        passed = self.passed(before_a_lag(whole, self.log_lag / sample_time))
        if self.lag:
            passed = after_a_lag(passed, self.lag / sample_time)
        return passed[len(whole) - len(logged) :]

    def behind(self, recording: Recording) -> Recording:
        """Return the recording with the amplifier's output as its input, and without filters."""
        if self.filters_positions:
            recording = self._unfiltered(recording)
        if recording.input is None or not self.corrects:
            return recording
        reached = self.reached(recording.input, recording.sample_time)
        # A torque or current has no dead zone, so the logged one was computed from a voltage.
        from_voltage = recording.from_voltage or self.dead_zone > 0.0
        return replace(recording, input=reached, from_voltage=from_voltage)

    def _unfiltered(self, recording: Recording) -> Recording:
        """Return the recording with positions from before their filters, without velocities."""
        # A smooth derivative adds less noise than a difference of two samples.
        motor, link = recording.motor_position, recording.link_position
        moved = motor + self.motor_lag * velocity(motor, recording.sample_time)
        if link is not None:
            still, shown = (motor, moved) if recording.link_from_deflection else (0.0, 0.0)
            sensed = link - still
            link = shown + sensed + self.link_lag * velocity(sensed, recording.sample_time)
        return replace(
            recording,
            motor_position=moved,
            link_position=link,
            motor_velocity=None,
            link_velocity=None,
        )


IDEAL = Amplifier()
"""Amplifier that changes nothing."""


def prepare(
    logs: Sequence[Log], share: float, model: Kind | Auto = "auto"
) -> tuple[SplitRecordings, tuple[str, ...]]:
    """Return the recordings that are long enough, and warnings about parts that were left out."""
    check_distinct(logs)
    check_alike(logs)
    taken, rigid = _visible_model(model, logs)
    every = [
        (group, _with_channels_of(taken, recording))
        for group, log in enumerate(logs)
        for recording in log.recordings
    ]
    free = [(group, _while_free(recording)) for group, recording in every]
    recordings = [(group, _while_moving(recording)) for group, recording in free]
    rigid += [
        warning
        for (_, whole), (_, driven), (_, moving) in zip(every, free, recordings, strict=True)
        for warning in (*_hold_left_out(whole, driven), *_rest_left_out(driven, moving))
    ]
    kept = _long_enough(recordings, share)
    warnings = rigid + [
        _left_out(log.source, short)
        for number, log in enumerate(logs)
        if kept
        and (short := [r for group, r in recordings if group == number and (group, r) not in kept])
    ]
    groups, recorded = zip(*(kept or recordings), strict=True)
    starts = tuple(_held_out_start(recording, share) for recording in recorded)
    return SplitRecordings(recorded, starts, groups), tuple(warnings)


def _visible_model(model: Kind | Auto, logs: Sequence[Log]) -> tuple[Kind | Auto, list[str]]:
    """Return the model and warnings; the rigid joint if the deflection is only noise."""
    recordings = [recording for log in logs for recording in log.recordings]
    if model != "auto" or not all(map(_shows_no_deflection, recordings)):
        return model, []
    off = max(float(recording.deflection.std()) for recording in recordings)
    reason = (
        f"{logs[0].source}: link and motor position differ by noise of {off:.2g} "
        f"{unit_of('rad', recordings[0].joint)} alone, "
        f"so the joint was taken as rigid: check that each encoder is connected to its own side, "
        f"or drive the joint harder"
    )
    return "rigid", [Caution(reason, Rank.SCALE)]


def _shows_no_deflection(recording: Recording) -> bool:
    """Whether link and motor move alike, but for noise or steps of their encoders."""
    link, motor = recording.link_position, recording.motor_position
    if link is None or recording.input is None or is_noise(motor):
        return False
    deflection = recording.deflection
    if is_noise(deflection):
        return True
    # Of a small deflection, coarse encoders show single steps, which are no white noise.
    noise = hypot(position_noise(link), position_noise(motor))
    return not recording.link_from_deflection and float(deflection.std()) < noise


def _while_moving(recording: Recording) -> Recording:
    """Return the recording without most of the rest before and after its motion."""
    positions = (recording.link_position, recording.motor_position)
    moving = while_moving([position for position in positions if position is not None])
    return _part(recording, moving)


def _part(recording: Recording, kept: slice) -> Recording:
    """Return these samples of a recording; the recording itself if these are all."""
    is_whole = kept == slice(0, len(recording))
    return recording if is_whole else recording.window(kept.start, kept.stop)


def _rest_left_out(whole: Recording, moving: Recording) -> list[str]:
    """Return the warning about rest that was left out, if there is some."""
    text = (
        f"{whole.source}: nothing moves {_left_ends(whole, moving, 'long ')}, so only the motion "
        f"was used: record motion alone"
    )
    return [] if len(moving) == len(whole) else [Caution(text, Rank.NOTE)]


def _while_free(recording: Recording) -> Recording:
    """Return the recording without the ends at which a brake holds the motor against the input."""
    if recording.input is None or not np.ptp(recording.motor_position):
        return recording
    return _part(recording, while_free(recording.motor_position, recording.input))


def _hold_left_out(whole: Recording, free: Recording) -> list[str]:
    """Return the warning about the ends at which a brake holds the motor, if there are some."""
    text = (
        f"{whole.source}: the motor rests {_left_ends(whole, free)} though the input acts, as if a "
        f"brake or a stop held it, so these samples were left out: log while the motor is free"
    )
    return [] if len(free) == len(whole) else [Caution(text, Rank.DATA)]


def _left_ends(whole: Recording, part: Recording, how: str = "") -> str:
    """Ends of a recording that a part leaves out, as times for a message."""
    (began, ended), (first, last) = (one.time[[0, -1]].tolist() for one in (whole, part))
    rounding = 0.5 * whole.sample_time
    before = [f"{how}before {first:.4g} s"] if first > began + rounding else []
    after = [f"{how}after {last:.4g} s"] if last < ended - rounding else []
    return " and ".join(before + after)


def _left_out(source: str, short: list[Recording]) -> str:
    """Return the warning about a log's recordings that are too short."""
    shown = [f"the {len(one)} samples from {one.start_time:g} s on" for one in short[:3]]
    more = f" and {len(short) - 3} more recordings" if len(short) > 3 else ""
    return (
        f"{source}: {', '.join(shown)}{more} are too few to fit and validate, so they were left "
        f"out: record without gaps"
    )


def _with_channels_of(model: Kind | Auto, recording: Recording) -> Recording:
    """Return the recording with only the channels of the model."""
    if model == "auto":
        return recording
    if model != "rigid" and recording.link_position is None:
        raise SettingError(
            "model", f"{recording.source} has no link position, which {model} needs: give rigid"
        )
    if model != "link" and recording.input is None:
        raise SettingError(
            "model", f"{recording.source} has no input, which {model} needs: give link"
        )
    if model == "link":
        return replace(recording, input=None, input_unit="", from_voltage=False)
    return _whole_drive(recording) if model == "rigid" else recording


def _whole_drive(recording: Recording) -> Recording:
    """Return the recording of one motion: the mean of both sides, about the motor's zero."""
    # With inertias J1 and J2 and the deflection δ, the input moves J1 + J2 along the mean, and (J2
    # - J1) δ'' / 2 more. Along the motor's motion it would be J2 δ''.
    alone = replace(recording, link_position=None, link_velocity=None)
    if recording.link_position is None or recording.clamped or _shows_no_deflection(recording):
        return alone
    deflection = recording.deflection
    speeds = recording.motor_velocity, recording.link_velocity
    mean = None if speeds[0] is None or speeds[1] is None else 0.5 * (speeds[0] + speeds[1])
    position = recording.motor_position + 0.5 * (deflection - deflection.mean())
    return replace(alone, motor_position=position, motor_velocity=mean)


class Source(Protocol):
    """Origin of a log."""

    @property
    def source(self) -> str:
        """Name of the log."""
        ...

    @property
    def sha256(self) -> str:
        """Hash of the file; empty without a file."""
        ...

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Details of the origin."""
        ...


def check_distinct(logs: Sequence[Source]) -> None:
    """Raise if two logs have the same data, which would narrow every interval wrongly."""
    sources: dict[str, str] = {}
    for log in logs:
        if log.sha256 and log.sha256 in sources:
            raise RecordingError(
                log.source, "", f"has the same data as {sources[log.sha256]}: give it only once"
            )
        sources[log.sha256] = log.source


def traits(joint: JointType, input_unit: str) -> dict[str, str]:
    """Properties that logs of one drive must share, by channel, as text for messages."""
    drive = f"in {input_unit}" if input_unit else "missing"
    return {"motor_position": f"that of a {joint} joint", "input": drive}


def check_alike(logs: Sequence[Log]) -> None:
    """Raise if logs differ in type of joint, input, encoders or signs of encoders."""
    found = []
    for log in logs:
        first = log.recordings[0]
        seen = {"link_position": "missing" if first.link_position is None else "there"}
        found.append(traits(first.joint, first.input_unit) | seen)
    for log, own in zip(logs, found, strict=True):
        for channel, words in own.items():
            if words != (other := found[0][channel]):
                reason = f"is {words}, and in {logs[0].source} {other}: take them one by one"
                raise RecordingError(log.source, channel, reason)
    turned = next((log for log in logs if log.turned), logs[0])
    for log in logs:
        for channel in {*turned.turned} ^ {*log.turned}:
            raise RecordingError(
                log.source,
                channel,
                f"shows another sign than in {turned.source}, or none: write its scale in a column "
                f"map (-1 where it counts against the motor's direction)",
            )


def _long_enough(
    recordings: Sequence[tuple[int, Recording]], share: float
) -> list[tuple[int, Recording]]:
    """Return the recordings with enough samples to fit, without the shortest ones of each log."""
    enough = [
        (group, recording)
        for group, recording in recordings
        if round(len(recording) * (1 - share)) >= _FEWEST_TRAINING_SAMPLES
    ]
    left_out = []
    for log in {group for group, _ in enough}:
        own = sorted((r for group, r in enough if group == log), key=len)
        held = np.cumsum([*map(len, own)])
        left_out += own[: np.searchsorted(held, _SHORTEST * held[-1], side="right")]
    return [(group, r) for group, r in enough if not any(r is other for other in left_out)]


def _held_out_start(recording: Recording, share: float) -> int:
    start = round(len(recording) * (1 - share))
    if start < _FEWEST_TRAINING_SAMPLES:
        raise RecordingError(
            recording.source,
            f"recording from {recording.start_time:g} s",
            f"has {len(recording)} samples, of which {100 * share:.0f} % are kept out for "
            f"validation and {start} are left to fit, fewer than {_FEWEST_TRAINING_SAMPLES}: "
            f"record {ceil(_FEWEST_TRAINING_SAMPLES / (1 - share))} or more without a gap",
        )
    if len(recording) - start < _FEWEST_HELD_OUT_SAMPLES:
        raise SettingError(
            "validation_share",
            f"{share:g} keeps only {len(recording) - start} samples of {recording.source} out, "
            f"fewer than {_FEWEST_HELD_OUT_SAMPLES}: raise it, or record longer",
        )
    return start


DelayStatus: TypeAlias = Literal["given", "found", "none"]


@dataclass(frozen=True)
class Delay:
    """Delay of one channel against the motor's encoder."""

    value: float  # in s: zero for status "none"
    std: float  # in s
    interval: tuple[float, float]  # in s, at 95 %; for status "none", in the full model
    status: DelayStatus  # whether the delay was given, was found or is not in the model


@dataclass(frozen=True)
class Alignment:
    """Hold of the input, and delays of the channels against the motor's encoder."""

    hold: Hold  # how the input behaves between samples
    input_delay: Delay  # positive if the input acts later than it was logged
    # positive if the link's encoder lags behind the motor's; for a measured deflection, if the
    # deflection's sensor lags
    link_delay: Delay
    hold_reason: str  # reason for the hold


def given_alignment(hold: Hold, input_delay: float, link_delay: float) -> Alignment:
    """Return an alignment with given delays in s."""
    of_input, of_link = (Delay(s, 0.0, (s, s), "given") for s in (input_delay, link_delay))
    return Alignment(hold, of_input, of_link, "")


def aligned(recording: Recording, alignment: Alignment) -> Recording:
    """Return the recording with all channels on the motor encoder's clock.

    The result lacks the samples at both ends that not all channels cover. The link's position, and
    its velocity if it was logged, are shifted in phase alone, so white noise stays white
    (`flexid.estimators.channel_timing`). The input becomes its mean over each sample's hold, or its
    value on the straight line between two samples.
    """
    drive = alignment.input_delay.value / recording.sample_time
    link = -alignment.link_delay.value / recording.sample_time
    acting, places = recording.input, np.arange(len(recording))
    if acting is not None and drive != 0.0:
        acting = np.interp(places - drive, places, acting)
    shifted = replace(recording, input=acting)
    first, last = max(ceil(drive), 0), max(ceil(-drive), 0)
    if recording.link_position is not None and link != 0.0:
        speed = recording.link_velocity
        if recording.link_from_deflection:  # the deflection alone is late
            position = recording.motor_position + later(recording.deflection, link)
            speed = None
        else:
            position = later(recording.link_position, link)
            speed = None if speed is None else later(speed, link)
        shifted = replace(shifted, link_position=position, link_velocity=speed)
        before, after = invalid_ends(link)
        first, last = max(first, before), max(last, after)
    return shifted.window(first, len(recording) - last) if first or last else recording
