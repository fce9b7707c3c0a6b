"""Whether the units and scales of a stream make sense: the checks of a log, once it has moved."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import RecordingError
from flexid.recording import checks
from flexid.recording.channel import ENCODERS, INPUTS, Draft
from flexid.recording.read import add_link_position, recording_of
from flexid.recording.sampling import GAP
from flexid.recording.slow_motion import check_motion
from flexid.recording.wraps import TURN
from flexid.streaming.channels import StreamChannels

_DURATION = 20.0  # s that are looked at
_FEWEST = 500  # samples of them
_MOST = 100_000
_MOVED = 0.1  # rad by which the motor has to move meanwhile; until then the stretch goes on


class Scales:
    """The first samples of a stream, until they are checked."""

    def __init__(self, source: str, channels: StreamChannels, sample_time: float) -> None:
        self._source, self._channels, self._sample_time = source, channels, sample_time
        self._wanted = min(max(round(_DURATION / sample_time), _FEWEST), _MOST)
        self._parts: list[FloatArray] | None = []  # None as soon as they are checked
        self._count = 0  # of samples in them

    def take(self, samples: FloatArray) -> tuple[str, ...]:
        """What is wrong, a sentence each, as soon as enough samples have come."""
        if self._parts is None:
            return ()
        self._parts.append(samples[np.isfinite(samples).all(axis=1)])
        self._count += len(self._parts[-1])
        if self._count < self._wanted:
            return ()
        taken = np.concatenate(self._parts)
        later = taken[:, 0] > np.maximum.accumulate(np.concatenate(([-np.inf], taken[:-1, 0])))
        taken = taken[later]
        names = [*self._channels.sampled]
        if len(taken) < _FEWEST or np.ptp(taken[:, names.index("motor_position")]) < _MOVED:
            self._parts, self._count = [], 0
            return ()
        self._parts = None
        return tuple(dict.fromkeys(self._found(dict(zip(names, taken.T, strict=True)))))

    def _found(self, values: dict[str, FloatArray]) -> list[str]:
        channels = {
            name: replace(channel, values=self._unwrapped(name, values[name]))
            for name, channel in self._channels.sampled.items()
        }
        log = Draft(self._source, channels, channels.pop("time"))
        for name in log.channels:
            checks.check_whole(log, name)
        if "deflection" not in log.channels:
            _check_encoders(log)
        for name in log.those_of(INPUTS):
            checks.check_power(log, name)
        add_link_position(log)
        gaps = np.flatnonzero(np.diff(log.time.values) > GAP * self._sample_time) + 1
        parts = [slice(*ends) for ends in pairwise((0, *gaps.tolist(), len(log.time.values)))]
        longest = max(parts, key=lambda part: part.stop - part.start)
        check_motion(log, recording_of(log, self._sample_time, longest))
        return log.warnings

    def _unwrapped(self, name: str, values: FloatArray) -> FloatArray:
        if name not in ENCODERS:
            return values
        geared = self._channels.motor_turn if name == "motor_position" else 0.0
        return np.unwrap(values, period=geared or TURN)


def _check_encoders(log: Draft) -> None:
    """Check the encoders; what a log would be refused for is a warning."""
    encoders = log.those_of(ENCODERS)
    try:
        if len(encoders) == 2:
            checks.check_two_encoders(log)
        for name in encoders:
            checks.check_speed(log, name)
    except RecordingError as error:
        log.warnings.append(str(error))
