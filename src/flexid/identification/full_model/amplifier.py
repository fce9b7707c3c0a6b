"""What an amplifier makes of the voltage that was logged: a dead zone, and a limit.

A voltage that was commanded is not what reaches the motor. Below the dead zone nothing passes, and
of more only what exceeds it; beyond the limit nothing follows. Neither is linear in the
coefficients, but both leave the balance of the motor linear in all else, so that least squares
shows which of them suit the log. Uncorrected, a dead zone of 3 % of the range makes the gain 8 %
and the inertias' ratio up to 13 % wrong.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.identification.full_model.model import Data, Structure
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.preparation.recordings import SplitRecordings
from flexid.recording.recording import Recording

_LARGEST_DEAD_ZONE, _LOWEST_LIMIT = 0.1, 0.2  # of the largest input
_NOTHING = np.finfo(float).tiny  # left by a log without noise
_TOLERANCE = 1e-3  # of the largest input
_RATES = (20.0, 60.0)  # 1/s, of filters that agree on what is no friction
# Of the motor's misfit that a correction saves at least, with either filter: dead zones of 2 to
# 4 % save half and more where an input takes all values, and hardly anything where it is a square
# wave, whose dead zone is a smaller gain.
_LEAST_SAVED = 0.1
# Of a recording's samples, those that are at least on either side of a limit: a square wave is on
# one side, and what passes for a limit is a gain that differs between two of them.
_CROSSING = 0.01
_SLOW = 0.1  # of the motor's usual speed, up to which it may stick
# Of a filter's memory, the share that may be of a slow motor: with more, rests show in the
# equations as dead zones of 4 to 10 % that are none.
_REMEMBERED = 0.02
_FORGOTTEN = 12.0  # time constants, after which a filter remembers less than 1e-4
_FEWEST = 100  # equations of a moving motor: ten for each coefficient
_DRIVEN = ("motor", "rigid")  # rows that an input drives


@dataclass(frozen=True)
class Amplifier:
    """Passes an input on; all of it unless told otherwise."""

    dead_zone: float = 0.0  # in the input's unit
    limit: float | None = None  # the same, of what was logged; None where none was seen

    @property
    def corrects(self) -> bool:
        """Whether it passes on anything but what it was given."""
        return self != IDEAL

    def passed(self, commanded: FloatArray) -> FloatArray:
        """What is left of an input."""
        limited = commanded
        if self.limit is not None:
            limited = np.clip(commanded, -self.limit, self.limit)
        return limited - np.clip(limited, -self.dead_zone, self.dead_zone)

    def behind(self, recording: Recording) -> Recording:
        """A recording with what reached the motor in place of what was commanded."""
        if recording.input is None or not self.corrects:
            return recording
        return replace(recording, input=self.passed(recording.input))

    def split_behind(self, recordings: SplitRecordings) -> SplitRecordings:
        """The same of recordings with their held-out ends."""
        return replace(recordings, recorded=tuple(map(self.behind, recordings.recorded)))


IDEAL = Amplifier()
"""Passes everything on."""


def amplifier_of(structure: Structure, data: Data) -> Amplifier:
    """The dead zone and the limit that a log shows."""
    largest = max(float(np.abs(samples.inputs[:, 0]).max()) for samples in data.samples)

    moves = {rate: _moves(data, rate) for rate in _RATES}
    if min(map(np.count_nonzero, moves.values())) < _FEWEST:
        return IDEAL

    @cache  # the best of a search was tried within it
    def misfits(candidate: Amplifier) -> FloatArray:
        return np.array([_misfit(structure, data, candidate, *each) for each in moves.items()])

    def with_dead_zone(share: float) -> Amplifier:
        return replace(found, dead_zone=share * largest)

    def with_limit(share: float) -> Amplifier:
        return replace(found, limit=share * largest)

    found, left = IDEAL, misfits(IDEAL)
    before = None
    while found != before:  # one shows, and is right, only beside the other
        before = found
        for corrected, ends in (
            (with_dead_zone, (0.0, _LARGEST_DEAD_ZONE)),
            (with_limit, (_LOWEST_LIMIT, 1.0)),
        ):
            best = _best(corrected, ends, misfits)
            remaining = misfits(best)
            if _is_crossed(data, best) and np.all(remaining < (1.0 - _LEAST_SAVED) * left):
                found, left = best, remaining
    return found


def _is_crossed(data: Data, amplifier: Amplifier) -> bool:
    """Whether some recording has an input on both sides of the limit, if there is one."""
    if amplifier.limit is None:
        return True
    beyond = [np.mean(np.abs(own.inputs[:, 0]) > amplifier.limit) for own in data.samples]
    return any(_CROSSING <= share <= 1.0 - _CROSSING for share in beyond)


def _best(
    corrected: Callable[[float], Amplifier],
    ends: tuple[float, float],
    misfits: Callable[[Amplifier], FloatArray],
) -> Amplifier:
    """The correction that leaves least, as a geometric mean over the filters."""
    # Slow to import, and few logs hold a voltage.
    from scipy.optimize import minimize_scalar

    least = minimize_scalar(
        lambda share: float(np.log(np.maximum(misfits(corrected(share)), _NOTHING)).sum()),
        bounds=ends,
        method="bounded",
        options={"xatol": _TOLERANCE},
    )
    return corrected(float(least.x))


def _misfit(
    structure: Structure, data: Data, amplifier: Amplifier, rate: float, moves: NDArray[np.bool_]
) -> float:
    """Sum of squares that least squares leaves of the driven balance where its motor moves."""
    samples = tuple(
        replace(
            own,
            inputs=np.column_stack((amplifier.passed(own.inputs[:, 0]), own.inputs[:, 1:])),
        )
        for own in data.samples
    )
    _, fit = least_squares_start(structure, replace(data, samples=samples), rate)
    (row,) = (row for row in fit.rows if row.name in _DRIVEN)
    left = row.left_hand_side - row.over(moves) @ row.regressors
    return float(np.sum(left[moves] ** 2))


def _moves(data: Data, rate: float) -> NDArray[np.bool_]:
    """Equations of a filter that hardly remembers that the motor was slow.

    While it sticks, its friction takes up whatever voltage acts, as a dead zone would.
    """
    speeds = []
    for samples in data.samples:
        assert samples.velocities is not None
        speeds.append(np.abs(samples.velocities[:, -1]))
    slow = _SLOW * np.sqrt(np.mean(np.concatenate(speeds) ** 2))
    # The response of the filter, a double pole, to an impulse, until nothing is left of it.
    pole = np.exp(-rate * data.samples[0].sample_time)
    places = np.arange(np.ceil(_FORGOTTEN / (1.0 - pole)))
    response = (1.0 - pole) ** 2 * (places + 1.0) * pole**places
    remembered = [np.convolve(speed <= slow, response)[1 : len(speed) - 1] for speed in speeds]
    return np.concatenate(remembered) <= _REMEMBERED
