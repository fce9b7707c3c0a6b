"""How a log's channels lie in time, and a log with all of them on one clock.

The motor encoder's clock is the clock. What is late matters much: an encoder that is read 3 ms late
shows a deflection wherever the joint moves, and a torque that acts half a sample later than it
stands in the log turns into friction. The prediction error seeks delays like coefficients; what
cannot, least squares and the paper's observer, takes a log that was aligned before.
"""

from dataclasses import dataclass, replace
from math import ceil, floor
from typing import Literal, TypeAlias

import numpy as np

from flexid.arrays import FloatArray
from flexid.recording.recording import Hold, Recording
from flexid.recording.shift import later, spoilt

DelayStatus: TypeAlias = Literal["given", "found", "none"]


@dataclass(frozen=True)
class Delay:
    """A delay of one channel against the motor's encoder."""

    value: float  # in s: zero unless one was given or found
    std: float  # in s
    interval: tuple[float, float]  # in s, at 95 %; of one that is none, what it could be
    status: DelayStatus  # where it comes from


@dataclass(frozen=True)
class Alignment:
    """Hold of the input, and delays of the channels against the motor's encoder."""

    hold: Hold  # how the input behaves between samples
    input_delay: Delay  # positive if the input acts later than it stands in the log
    # positive if the link's encoder shows where the link was so much earlier; of a deflection that
    # was measured, where the deflection was
    link_delay: Delay
    hold_reason: str  # why this hold


def aligned(recording: Recording, alignment: Alignment) -> Recording:
    """Return the recording with all channels on the motor encoder's clock.

    Returns shorter by the samples at both ends that not all channels cover. The link's
    position, and its velocity if it was logged, are shifted in phase alone, which leaves white
    noise white (`flexid.recording.shift`). The input becomes its mean over each sample's hold,
    or its value on the straight line between two samples.
    """
    drive = alignment.input_delay.value / recording.sample_time
    link = -alignment.link_delay.value / recording.sample_time
    acting = None if recording.input is None else _later_input(recording.input, drive)
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
        before, after = spoilt(link)
        first, last = max(first, before), max(last, after)
    return shifted.window(first, len(recording) - last) if first or last else recording


def _later_input(values: FloatArray, samples: float) -> FloatArray:
    """An input, held or on straight lines, moved to later times by any part of a sample."""
    whole = floor(samples)
    part = samples - whole
    places = np.arange(len(values)) - whole
    last = len(values) - 1
    return (1.0 - part) * values[np.clip(places, 0, last)] + part * values[
        np.clip(places - 1, 0, last)
    ]
