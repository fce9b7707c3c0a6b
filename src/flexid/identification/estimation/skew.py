"""A delay between two encoders that passes for a spring."""

from dataclasses import dataclass, replace

import numpy as np

from flexid.identification.full_model.model import Data
from flexid.identification.preparation.alignment import Alignment, Delay
from flexid.identification.preparation.joint import Joint
from flexid.identification.vocabulary.intervals import interval
from flexid.recording.velocities import position_noise

_PARTS = 10  # of a log, whose delays differ by as much as they are uncertain
_MOSTLY = 0.8  # share of the deflection's variance; of a spring's motion less is in one phase


@dataclass(frozen=True)
class Skew:
    """A delay between the encoders, in place of a spring."""

    delay: float  # in s, that explains most of the deflection
    deviation: float  # its standard deviation in s, from the spread between parts of the log
    explained: float  # its share of the deflection's variance
    excess: float  # what it leaves, as a mean square over that of the deflection's noise
    by_spring: float  # share of what it leaves that goes with the link's acceleration

    @property
    def makes_the_deflection(self) -> bool:
        """Whether a delay explains so much of the deflection that no spring is known.

        What it leaves may be little, and still all that a spring does.
        """
        return self.explained > _MOSTLY > self.by_spring

    def delays_the_link(self, alignment: Alignment) -> Alignment:
        """An alignment in which the link's encoder is late by this, which the fit took as given."""
        ends = interval(self.delay, self.deviation, _PARTS - 1)
        return replace(alignment, link_delay=Delay(self.delay, self.deviation, ends, "found"))


def skew(joint: Joint, data: Data) -> Skew:
    """What a delay between the encoders makes of the deflection."""
    rows, left, noise, count = [], [], 0.0, sum(map(len, data.samples))
    for samples in data.samples:
        assert samples.velocities is not None
        speed, acceleration = samples.velocities[:, -1], np.gradient(samples.velocities[:, 0])
        rows.append(np.column_stack((speed - speed.mean(), acceleration)))
        deflection = joint.channels_of(samples.positions, samples.inputs)[:, -1]
        left.append(deflection - deflection.mean())
        noise += len(samples) / count * position_noise(deflection) ** 2
    regressors, deflection = np.concatenate(rows), np.concatenate(left)
    solution = np.linalg.lstsq(regressors, deflection)[0]
    parts = zip(*(np.array_split(each, _PARTS) for each in (regressors, deflection)), strict=True)
    delays = [np.linalg.lstsq(rows_of, of_part)[0][0] for rows_of, of_part in parts]
    late = deflection - regressors[:, 0] * solution[0]
    remaining = float(np.var(late))
    beyond = (
        float(np.var(late - regressors[:, 1] * solution[1])) if solution[1] < 0.0 else remaining
    )
    least = np.finfo(float).tiny
    return Skew(
        -float(solution[0]),
        float(np.std(delays, ddof=1)) / np.sqrt(_PARTS),
        1.0 - remaining / max(float(np.var(deflection)), least),
        remaining / max(noise, least),
        1.0 - beyond / max(remaining, least),
    )


def shifted(data: Data, delay: float) -> Data:
    """A log whose link's positions are put a delay earlier."""
    moved = []
    for samples in data.samples:
        positions = samples.positions.copy()
        assert samples.velocities is not None
        positions[:, 0] += delay * samples.velocities[:, 0]
        moved.append(replace(samples, positions=positions))
    return replace(data, samples=tuple(moved))
