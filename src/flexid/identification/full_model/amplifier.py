"""Search for an amplifier's dead zone and limit, and for a filter between input and log.

The commanded input may differ from the input that reaches the motor. An amplifier has a limit, and
one with a voltage may have a dead zone: inputs within it have no effect, larger ones are reduced by
it. The input may also have been low-passed before it was logged.

Dead zone and limit are not linear coefficients. With both given, the motor's balance is linear in
all others, so least squares shows which values suit the log. Without correction, a dead zone of 3 %
of the range makes the gain 8 % and the ratio of inertias up to 13 % wrong.
"""

from collections.abc import Sequence
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
from flexid.models.flexible_joint import SHAPE_TERMS

_LARGEST_DEAD_ZONE, _LIMITS = 0.1, (0.1, 1.0)  # of the largest input
_LEAST_MISFIT = np.finfo(float).tiny  # for a log without noise
_TOLERANCE = 1e-3  # of the largest input
_FINE, _LEAST_SPREAD = 1e-3, 0.01  # of a lag: tolerance of its search; least standard deviation
RATES = (20.0, 60.0)  # 1/s, of filters whose results must agree
# Least relative fall of the motor's misfit by a correction, with either filter. Dead zones of 2 to
# 4 % cause half of the misfit or more if the input takes all values. For a square wave they cause
# hardly any misfit, since a dead zone only reduces its gain.
_LEAST_SAVED = 0.1
# The same for a torque or current, which has a dead zone only if it was computed from a voltage. In
# 14 such logs it saved 0.75 or more, or 0.29 with a limit; in 268 other logs at most 0.06.
_CLEARLY_SAVED = 0.25
_REFINED = 0.01  # least relative fall when a found correction is refined
# Longest filter of a log, over the time by which its input seems late there. Fast motions are late
# by less than the filter's lag, but then they hardly pass it.
_LONGEST_LAG = 10.0
_LAGS = np.geomspace(1e-3, 0.03, 8)  # s, time constants of filters of a logged current
# Least share of a recording's samples on either side of a limit. A square wave is on one side only;
# a different gain of two square waves may look like a limit.
_CROSSING = 0.01
_SLOW = 0.1  # of the motor's usual speed; below it the motor may stick
# Largest share of a filter's memory during which the motor is slow. With more, rest looks like dead
# zones of 4 to 10 % that do not exist.
_REMEMBERED = 0.02
_FORGOTTEN = 12.0  # time constants after which a filter's response is below 1e-4
_FEWEST = 100  # least number of equations of a moving motor: ten for each coefficient
# Least share of the input's squared cube beyond a gain. It is 0.1 for a sine, 0.16 for random
# levels, and 0.005 for square waves that drift by 5 % or have edges of 5 ms.
_BEYOND = 0.03
_NORMAL = 0.6745  # median of the absolute value of a standard normal variable
_DRIVEN = ("motor", "rigid")  # rows with the input


def shows_saturation(data: Data) -> bool:
    """Whether the cube of the input differs from a gain, an offset and noise.

    For a square wave it does not. There a cubic term would only fit noise, drift and edges of the
    input, and make the gain wrong by half of it or more.
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
    """Return the standard deviation of an input's white noise between jumps, from a median."""
    return float(np.median(np.abs(np.diff(values, 4)))) / (_NORMAL * sqrt(comb(8, 4)))


@dataclass(frozen=True, eq=False)
class DrivenBalance:
    """Least squares of the balance with the input, while the motor moves."""

    structure: Structure
    data: Data

    @cached_property
    def loaded(self) -> "DrivenBalance":
        """The balance with friction of the load, which a limit resembles."""
        joint, load = self.structure.joint, {*SHAPE_TERMS["load_friction"].coefficients}
        if not load <= joint.shapes:
            return self
        absent = self.structure.absent - load
        wider = replace(self.structure, joint=joint.with_shapes_in_least_squares, absent=absent)
        return DrivenBalance(wider, self.data)

    @cached_property
    def largest(self) -> float:
        """Largest absolute input."""
        return max(float(np.abs(samples.inputs[:, 0]).max()) for samples in self.data.samples)

    @cached_property
    def moves(self) -> dict[float, NDArray[np.bool_]]:
        """Whether the motor moves in each equation, by filter rate."""
        return {rate: motor_moves(self.data, rate) for rate in RATES}

    @property
    def is_enough(self) -> bool:
        """Whether the motor moves in enough equations."""
        return all(np.count_nonzero(moves) >= _FEWEST for moves in self.moves.values())

    def amplifier(self, *, is_voltage: bool) -> Amplifier:
        """Return the amplifier with the dead zone and the limit of a log.

        A current or a torque may be a commanded value, or computed from a voltage, so it may have
        them too.
        """
        if not self.is_enough:
            return IDEAL

        least = _LEAST_SAVED if is_voltage else _CLEARLY_SAVED
        corrections: dict[Literal["dead_zone", "limit"], tuple[tuple[float, float], float]] = {
            "dead_zone": ((0.0, _LARGEST_DEAD_ZONE), least),
            "limit": (_LIMITS, _LEAST_SAVED),
        }
        found, left = IDEAL, self.misfits(IDEAL)
        before = None
        while found != before:  # each is visible and correct only together with the other
            before = found
            for field, (ends, least) in corrections.items():
                best = self.best(found, field, ends)
                remaining = self.misfits(best)
                saved = least if getattr(found, field) == getattr(IDEAL, field) else _REFINED
                if _is_crossed(self.data, best) and np.all(remaining < (1.0 - saved) * left):
                    if field == "limit" and not self._is_limit(best, found, remaining, 1.0 - saved):
                        continue
                    found, left = best, remaining
        return found

    def _is_limit(
        self, limited: Amplifier, found: Amplifier, remaining: FloatArray, share: float
    ) -> bool:
        """Whether neither a filter of the log nor friction of the load does what a limit does."""
        with_load = self.loaded.misfits(limited) < share * self.loaded.misfits(found)
        return bool(np.all(with_load) and np.all(remaining <= share * self.sharpened(found)))

    def with_log_lag(self, amplifier: Amplifier, likely: float) -> Amplifier:
        """Return the amplifier with the log's filter of best fit, searched from `likely` in s."""
        if not self.is_enough:
            return amplifier
        return replace(amplifier, log_lag=self.best_log_lag(amplifier, likely))

    def limit_changes(self, amplifier: Amplifier) -> dict[str, float]:
        """Return signed relative standard deviations of coefficients from the limit's uncertainty.

        That uncertainty is the difference of the best limits with either filter.
        """
        if amplifier.limit is None:
            return {}
        limits = [self.best(amplifier, "limit", _LIMITS, (rate,)).limit or 0.0 for rate in RATES]
        spread = max(abs(limits[1] - limits[0]) / sqrt(2.0), _TOLERANCE * self.largest)
        return self.changes(amplifier, "limit", spread)

    def log_lag_changes(self, amplifier: Amplifier) -> dict[str, float]:
        """Return signed relative standard deviations from the log lag's uncertainty."""
        one, other = (self.best_log_lag(amplifier, amplifier.log_lag, (rate,)) for rate in RATES)
        spread = max(abs(one - other) / sqrt(2.0), _LEAST_SPREAD * amplifier.log_lag)
        return self.changes(amplifier, "log_lag", spread)

    def best(
        self,
        amplifier: Amplifier,
        field: Literal["dead_zone", "limit"],
        ends: tuple[float, float],  # of the largest input
        rates: Sequence[float] = RATES,
    ) -> Amplifier:
        """Return the amplifier with the least misfit, as a geometric mean over the filters."""
        # Imported late: it is slow, and few logs need it.
        from scipy.optimize import minimize_scalar

        def corrected(share: float) -> Amplifier:
            return replace(amplifier, **{field: share * self.largest})

        def left(share: float) -> FloatArray:
            return np.log(np.maximum(self.misfits(corrected(share), rates), _LEAST_MISFIT))

        least: Any = minimize_scalar(
            lambda share: float(left(share).sum()),
            bounds=ends,
            method="bounded",
            options={"xatol": _TOLERANCE},
        )
        return corrected(float(least.x))

    def best_log_lag(
        self, amplifier: Amplifier, likely: float, rates: Sequence[float] = RATES
    ) -> float:
        """Return the first-order lag in s with the least misfit, at the delay that suits it.

        Both are sought together, since a filter looks like a mixture of lag and delay. The lag is 0
        if an ever longer one leaves less, as for an input that does not drive the motor.
        """
        # Imported late: it is slow, and few logs need it.
        from scipy.optimize import minimize

        def left(lag_and_delay: FloatArray) -> float:
            lag, delay = lag_and_delay
            sums = self.misfits(replace(amplifier, log_lag=max(lag, 0.0)), rates, delay)
            return float(np.log(np.maximum(sums, _LEAST_MISFIT)).sum())

        around = likely * np.array([[1.0, 0.0], [2.0, 0.0], [1.0, 0.5]])
        options = {"initial_simplex": around, "xatol": _FINE * likely, "fatol": 1e-6}
        found: Any = minimize(left, around[0], method="Nelder-Mead", options=options)
        lag = float(found.x[0])
        return max(lag, 0.0) if lag < _LONGEST_LAG * likely else 0.0

    def changes(
        self, amplifier: Amplifier, field: Literal["limit", "log_lag"], spread: float
    ) -> dict[str, float]:
        """Return logarithms of the coefficients' ratios between both ends of a field's spread."""
        middle = getattr(amplifier, field)
        one, other = (
            self.coefficients(replace(amplifier, **{field: middle + half}), max(RATES))
            for half in (0.5 * spread, -0.5 * spread)
        )
        return {
            name: float(np.log(value / other[name]))
            for name, value in one.items()
            if value * other[name] > 0.0
        }

    def sharpened(self, amplifier: Amplifier) -> FloatArray:
        """Return the least misfit, by filter, if the log was low-passed.

        It is compared with a limit's, since a limit also sharpens the slow edges of a square wave.
        """
        lagging = (replace(amplifier, log_lag=lag) for lag in _LAGS)
        return np.min([self.misfits(each) for each in lagging], axis=0)

    def misfits(
        self, amplifier: Amplifier, rates: Sequence[float] = RATES, delay: float = 0.0
    ) -> FloatArray:
        """Return the residual sum of squares with an amplifier and a delay in s, by filter."""
        sums = []
        for rate in rates:
            row, values = self._fitted(amplifier, rate, delay)
            left = (row.left_hand_side - values @ row.regressors)[self.moves[rate]]
            sums.append(float(left @ left))
        return np.array(sums)

    def coefficients(self, amplifier: Amplifier, rate: float) -> dict[str, float]:
        """Return the coefficients of the balance with an amplifier."""
        row, values = self._fitted(amplifier, rate)
        return dict(zip(row.coefficients, values.tolist(), strict=True))

    def _fitted(
        self, amplifier: Amplifier, rate: float, delay: float = 0.0
    ) -> tuple[RowFit, FloatArray]:
        """Return the row and its least-squares values."""
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
    """Whether the input of some recording is on both sides of the limit; True without a limit."""
    if amplifier.limit is None:
        return True
    beyond = [np.mean(np.abs(own.inputs[:, 0]) > amplifier.limit) for own in data.samples]
    return any(_CROSSING <= share <= 1.0 - _CROSSING for share in beyond)


def motor_moves(data: Data, rate: float) -> NDArray[np.bool_]:
    """Return whether the motor was hardly ever slow in the filter's memory, by equation."""
    # While the motor sticks, friction balances the voltage, like a dead zone.
    speeds = []
    for samples in data.samples:
        assert samples.velocities is not None
        speeds.append(np.abs(samples.velocities[:, -1]))
    slow = _SLOW * np.sqrt(np.mean(np.concatenate(speeds) ** 2))
    # Impulse response of the filter, a double pole.
    pole = np.exp(-rate * data.samples[0].sample_time)
    places = np.arange(np.ceil(_FORGOTTEN / (1.0 - pole)))
    response = (1.0 - pole) ** 2 * (places + 1.0) * pole**places
    remembered = [np.convolve(speed <= slow, response)[1 : len(speed) - 1] for speed in speeds]
    return np.concatenate(remembered) <= _REMEMBERED
