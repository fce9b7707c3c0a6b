"""What an input was before it was logged, and what an amplifier made of it.

An amplifier has a limit, and of a voltage a dead zone; on its way into the log an input may have
been low-passed.

What was commanded is not what reaches the motor. Below the dead zone nothing passes, and of more
only what exceeds it; beyond the limit nothing follows. Neither is linear in the
coefficients, but both leave the balance of the motor linear in all else, so that least squares
shows which of them suit the log. Uncorrected, a dead zone of 3 % of the range makes the gain 8 %
and the inertias' ratio up to 13 % wrong.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import comb, sqrt
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import later
from flexid.estimators.state_variable_filter import RowFit
from flexid.identification.full_model.model import Data, Structure
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.preparation.recordings import IDEAL, Amplifier

_LARGEST_DEAD_ZONE, _LIMITS = 0.1, (0.1, 1.0)  # of the largest input
_NOTHING = np.finfo(float).tiny  # left by a log without noise
_TOLERANCE = 1e-3  # of the largest input
_FINE, _LEAST_SPREAD = 1e-3, 0.01  # of a lag: steps of its search; what no filter knows better
_RATES = (20.0, 60.0)  # 1/s, of filters that agree on what is no friction
# Of the motor's misfit that a correction saves at least, with either filter: dead zones of 2 to
# 4 % save half and more where an input takes all values, and hardly anything where it is a square
# wave, whose dead zone is a smaller gain.
_LEAST_SAVED = 0.1
_REFINED = 0.01  # the same of one that is corrected already, once the other one is
_LAGS = np.geomspace(1e-3, 0.03, 8)  # s, of filters of a drive for the current that it logs
# Of a recording's samples, those that are at least on either side of a limit: a square wave is on
# one side, and what passes for a limit is a gain that differs between two of them.
_CROSSING = 0.01
_SLOW = 0.1  # of the motor's usual speed, up to which it may stick
# Of a filter's memory, the share that may be of a slow motor: with more, rests show in the
# equations as dead zones of 4 to 10 % that are none.
_REMEMBERED = 0.02
_FORGOTTEN = 12.0  # time constants, after which a filter remembers less than 1e-4
_FEWEST = 100  # equations of a moving motor: ten for each coefficient
# Of a cube's squares, the share beyond a gain: 0.1 of a sine, 0.16 of random levels, and 0.005 of
# square waves that drift by 5 % or whose edges take 5 ms.
_BEYOND = 0.03
_NORMAL = 0.6745  # median of what is normally distributed, without its sign
_DRIVEN = ("motor", "rigid")  # rows that an input drives


def shows_saturation(data: Data) -> bool:
    """Whether a cube of the input is more than a gain, an offset and its noise.

    Of a square wave it is not: as a term it would take noise and drift of the input away, or
    sharpen its edges, and make the gain half as large again and more.
    """
    inputs = [own.inputs[:, 0] for own in data.samples]
    every = np.concatenate(inputs)
    cube = every**3
    columns = np.column_stack((every, np.ones_like(every)))
    gain, offset = np.linalg.lstsq(columns, cube)[0]
    beyond = np.sum((cube - gain * every - offset) ** 2)
    noise = sum(np.sum((_white_noise(u) * (3.0 * u**2 - gain)) ** 2) for u in inputs)
    return bool(beyond - noise > _BEYOND * (cube @ cube))


def _white_noise(values: FloatArray) -> float:
    """Standard deviation of what is white between the jumps of an input, by a median."""
    return float(np.median(np.abs(np.diff(values, 4)))) / (_NORMAL * sqrt(comb(8, 4)))


def amplifier_of(structure: Structure, data: Data, *, is_voltage: bool) -> Amplifier:
    """The limit that a log shows; of a voltage also the dead zone, which is a friction of others.

    A current is controlled, and a torque is what acts, but either may be what was commanded.
    """
    driven = _Driven(structure, data)
    if not driven.is_enough:
        return IDEAL

    corrections: dict[Literal["dead_zone", "limit"], tuple[float, float]] = {"limit": _LIMITS}
    if is_voltage:
        corrections = {"dead_zone": (0.0, _LARGEST_DEAD_ZONE), **corrections}
    found, left = IDEAL, driven.misfits(IDEAL)
    before = None
    while found != before:  # one shows, and is right, only beside the other
        before = found
        for field, ends in corrections.items():
            best = driven.best(found, field, ends)
            remaining = driven.misfits(best)
            saved = _LEAST_SAVED if getattr(found, field) == getattr(IDEAL, field) else _REFINED
            if _is_crossed(data, best) and np.all(remaining < (1.0 - saved) * left):
                if field == "limit" and np.any(remaining > (1.0 - saved) * driven.sharpened(found)):
                    continue
                found, left = best, remaining
    return found


def with_log_lag(
    structure: Structure, data: Data, amplifier: Amplifier, likely: float
) -> Amplifier:
    """The same amplifier, logged behind the filter that suits the log best, about as `likely`."""
    driven = _Driven(structure, data)
    if not driven.is_enough:
        return amplifier
    return replace(amplifier, log_lag=driven.best_log_lag(amplifier, likely))


def limit_changes(structure: Structure, data: Data, amplifier: Amplifier) -> dict[str, float]:
    """Relative standard deviations, with their signs, that the limit's own makes of coefficients.

    Each filter has a limit that suits it best: by as much as they differ, it is not known.
    """
    if amplifier.limit is None:
        return {}
    driven = _Driven(structure, data)
    limits = [driven.best(amplifier, "limit", _LIMITS, (rate,)).limit or 0.0 for rate in _RATES]
    spread = max(abs(limits[1] - limits[0]) / sqrt(2.0), _TOLERANCE * driven.largest)
    return driven.changes(
        replace(amplifier, limit=amplifier.limit + half) for half in (0.5 * spread, -0.5 * spread)
    )


def log_lag_changes(structure: Structure, data: Data, amplifier: Amplifier) -> dict[str, float]:
    """The same of the lag of the log."""
    driven = _Driven(structure, data)
    one, other = (driven.best_log_lag(amplifier, amplifier.log_lag, (rate,)) for rate in _RATES)
    spread = max(abs(one - other) / sqrt(2.0), _LEAST_SPREAD * amplifier.log_lag)
    return driven.changes(
        replace(amplifier, log_lag=amplifier.log_lag + half)
        for half in (0.5 * spread, -0.5 * spread)
    )


@dataclass(frozen=True, eq=False)
class _Driven:
    """The driven balance of a log, by least squares where its motor moves."""

    structure: Structure
    data: Data

    @cached_property
    def largest(self) -> float:
        """The largest input."""
        return max(float(np.abs(samples.inputs[:, 0]).max()) for samples in self.data.samples)

    @cached_property
    def moves(self) -> dict[float, NDArray[np.bool_]]:
        """By filter, whether the motor moves, equation by equation."""
        return {rate: _moves(self.data, rate) for rate in _RATES}

    @property
    def is_enough(self) -> bool:
        """Whether the motor moves in enough equations."""
        return all(np.count_nonzero(moves) >= _FEWEST for moves in self.moves.values())

    def best(
        self,
        amplifier: Amplifier,
        field: Literal["dead_zone", "limit"],
        ends: tuple[float, float],  # of the largest input
        rates: Sequence[float] = _RATES,
    ) -> Amplifier:
        """The amplifier with which least is left, as a geometric mean over the filters."""
        # Slow to import, and few logs need it.
        from scipy.optimize import minimize_scalar

        def corrected(share: float) -> Amplifier:
            return replace(amplifier, **{field: share * self.largest})

        def left(share: float) -> FloatArray:
            return np.log(np.maximum(self.misfits(corrected(share), rates), _NOTHING))

        least: Any = minimize_scalar(
            lambda share: float(left(share).sum()),
            bounds=ends,
            method="bounded",
            options={"xatol": _TOLERANCE},
        )
        return corrected(float(least.x))

    def best_log_lag(
        self, amplifier: Amplifier, likely: float, rates: Sequence[float] = _RATES
    ) -> float:
        """The lag in s, of first order, with which the least is left, at the delay that suits it.

        Of a filter either has a part of the other.
        """
        # Slow to import, and few logs need it.
        from scipy.optimize import minimize

        def left(lag_and_delay: FloatArray) -> float:
            lag, delay = lag_and_delay
            sums = self.misfits(replace(amplifier, log_lag=max(lag, 0.0)), rates, delay)
            return float(np.log(np.maximum(sums, _NOTHING)).sum())

        around = likely * np.array([[1.0, 0.0], [2.0, 0.0], [1.0, 0.5]])
        options = {"initial_simplex": around, "xatol": _FINE * likely, "fatol": 1e-6}
        found: Any = minimize(left, around[0], method="Nelder-Mead", options=options)
        return max(float(found.x[0]), 0.0)

    def changes(self, of_two: Iterable[Amplifier]) -> dict[str, float]:
        """Logarithms of the ratios of the coefficients behind two amplifiers."""
        one, other = (self.coefficients(amplifier, max(_RATES)) for amplifier in of_two)
        return {
            name: float(np.log(value / other[name]))
            for name, value in one.items()
            if value * other[name] > 0.0
        }

    def sharpened(self, amplifier: Amplifier) -> FloatArray:
        """What is left at least, by filter, of an input that was low-passed into the log.

        Its edges are slow, and a limit makes those of a square wave as sharp as they were.
        """
        lagging = (replace(amplifier, log_lag=lag) for lag in _LAGS)
        return np.min([self.misfits(each) for each in lagging], axis=0)

    def misfits(
        self, amplifier: Amplifier, rates: Sequence[float] = _RATES, delay: float = 0.0
    ) -> FloatArray:
        """Sums of squares that are left behind an amplifier, by filter, if it is late by s."""
        sums = []
        for rate in rates:
            row, values = self._fitted(amplifier, rate, delay)
            left = (row.left_hand_side - values @ row.regressors)[self.moves[rate]]
            sums.append(float(left @ left))
        return np.array(sums)

    def coefficients(self, amplifier: Amplifier, rate: float) -> dict[str, float]:
        """What the balance says behind an amplifier."""
        row, values = self._fitted(amplifier, rate)
        return dict(zip(row.coefficients, values.tolist(), strict=True))

    def _fitted(
        self, amplifier: Amplifier, rate: float, delay: float = 0.0
    ) -> tuple[RowFit, FloatArray]:
        """The row, and least squares of it."""
        samples = tuple(
            replace(own, inputs=np.column_stack((reached, own.inputs[:, 1:])))
            for own in self.data.samples
            for late in [later(own.inputs[:, 0], delay / own.sample_time)]
            for reached in [amplifier.reached(late, own.sample_time)]
        )
        _, fit = least_squares_start(self.structure, replace(self.data, samples=samples), rate)
        (row,) = (row for row in fit.rows if row.name in _DRIVEN)
        return row, row.over(self.moves[rate])


def _is_crossed(data: Data, amplifier: Amplifier) -> bool:
    """Whether some recording has an input on both sides of the limit, if there is one."""
    if amplifier.limit is None:
        return True
    beyond = [np.mean(np.abs(own.inputs[:, 0]) > amplifier.limit) for own in data.samples]
    return any(_CROSSING <= share <= 1.0 - _CROSSING for share in beyond)


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
