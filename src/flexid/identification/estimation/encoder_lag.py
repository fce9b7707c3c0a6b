"""First-order filters of the encoders before the log, in place of delays.

A filter delays an encoder, and also attenuates it. At a resonance ω a lag τ has the gain
1 / sqrt(1 + (ω τ)²), so a fit with a delay makes inertias and stiffness wrong. The lag replaces a
part of the delay. It is the one with which least squares of both balances leave the least. If the
motor's encoder is late, link and input seem early and late. If both encoders are, the input does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log, sqrt
from typing import Any, NamedTuple

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.channel_timing import INPUT
from flexid.identification.full_model.amplifier import RATES, motor_moves
from flexid.identification.full_model.model import LINK, Data, Structure, data_of
from flexid.identification.full_model.starting import least_squares_start
from flexid.identification.preparation.recordings import Amplifier, aligned, given_alignment
from flexid.recording.velocities import with_velocities

_OF_LINK, _OF_MOTOR, _OF_INPUT = "link_lag", "motor_lag", "lag"  # fields of `Amplifier`
_TRIED = (0.5, 1.0)  # of a delay: lags of which one must leave less than the delay
_LONGEST = 2.0  # of a delay: longest lag that is sought in its place
_FINE = 0.01  # of a delay: tolerance of the search, and least standard deviation
# Fall of the misfit, to half: the product of both residual squares fell to a tenth or less in logs
# of encoders behind filters of 10 to 30 Hz, and to 0.8 or more in those of delays.
_CLEAR = log(2.0)


class EncoderLag(NamedTuple):
    """Correction of an input and of filtered encoders."""

    amplifier: Amplifier
    errors: dict[str, float]  # relative errors of coefficients by that of the lag


def likely_encoder_lag(
    structure: Structure,
    logged: Data,
    amplifier: Amplifier,
    delays: Mapping[str, float],
    least: float,
    *,
    of_both: bool,
) -> EncoderLag | None:
    """Return the lag that clearly explains more than a fit's delays in s; None if none does.

    `logged` are data without corrections, `amplifier` corrects their input. A delay up to `least`
    s shows no lag. A delay of the input may be a lag `of_both` encoders.
    """
    late, drive = delays.get(LINK, 0.0), delays.get(INPUT, 0.0)
    if of_both != (abs(late) <= least) or max(abs(late), drive) <= least:
        return None
    sides = (_OF_LINK, _OF_MOTOR)
    if not of_both:
        sides = sides[:1] if late > 0.0 else sides[1:]
    filtered = FilteredEncoder(structure, logged, amplifier, late, drive, sides)
    lag = filtered.likely_lag()
    if lag and of_both:  # an amplifier's lag does the same, but for friction and gravity
        driven = replace(filtered, lags=(_OF_INPUT,))
        if driven.misfit(driven.best(RATES)) < filtered.misfit(lag):
            return None
    return EncoderLag(filtered.corrected(lag), filtered.errors(lag)) if lag else None


@dataclass(frozen=True, eq=False)
class FilteredEncoder:
    """Least squares of both balances with lags in place of delays."""

    structure: Structure
    logged: Data
    amplifier: Amplifier
    late: float  # delays in s of the link's encoder, and of the input
    drive: float
    lags: tuple[str, ...]  # fields of the amplifier, which are alike

    @property
    def _size(self) -> float:
        """Delay in s that a lag replaces."""
        return abs(self.late) if self.lags in ((_OF_LINK,), (_OF_MOTOR,)) else self.drive

    def likely_lag(self) -> float:
        """Return the lag in s that leaves clearly less than the delay; 0 if none does."""
        before = self.misfit(0.0)
        if min(self.misfit(share * self._size) for share in _TRIED) > before:
            return 0.0
        lag = self.best(RATES)
        is_inside = lag < (1.0 - _FINE) * _LONGEST * self._size
        return lag if is_inside and self.misfit(lag) < before - _CLEAR else 0.0

    def errors(self, lag: float) -> dict[str, float]:
        """Return logarithms of the coefficients' ratios by the difference of both filters' lags."""
        one, other = (self.best((rate,)) for rate in RATES)
        spread = max(abs(one - other) / sqrt(2.0), _FINE * self._size)
        more, less = (self._values(lag + half) for half in (0.5 * spread, -0.5 * spread))
        return {n: log(more[n] / less[n]) for n in more if more[n] * less[n] > 0.0}

    def misfit(self, lag: float, rates: Sequence[float] = RATES) -> float:
        """Return the logarithm of both balances' relative residual squares with a lag in s.

        It is the mean over the filters.
        """
        return sum(log(share) for share, _ in self._rows(lag, rates)) / len(rates)

    def best(self, rates: Sequence[float]) -> float:
        """Return the lag in s with the least misfit."""
        from scipy.optimize import minimize_scalar  # late: it is slow, and few logs need it

        least: Any = minimize_scalar(
            lambda lag: self.misfit(lag, rates),
            bounds=(0.0, _LONGEST * self._size),
            method="bounded",
            options={"xatol": _FINE * self._size},
        )
        return float(least.x)

    def corrected(self, lag: float) -> Amplifier:
        """Return the amplifier with this lag in s."""
        return replace(self.amplifier, **dict.fromkeys(self.lags, lag))

    def _values(self, lag: float) -> dict[str, float]:
        return {n: v for _, values in self._rows(lag, RATES[-1:]) for n, v in values.items()}

    def _rows(self, lag: float, rates: Sequence[float]) -> list[tuple[float, dict[str, float]]]:
        """Return the relative residual square and the values of each balance, by filter."""
        data = self._unfiltered(lag)
        found = []
        for rate in rates:
            kept = motor_moves(data, rate)
            for row in least_squares_start(self.structure, data, rate)[1].rows:
                values, whole = row.over(kept), row.left_hand_side[kept]
                left: FloatArray = whole - values @ row.regressors[:, kept]
                share = max(float(left @ left) / float(whole @ whole), np.finfo(float).tiny)
                found.append((share, dict(zip(row.coefficients, values.tolist(), strict=True))))
        return found

    def _unfiltered(self, lag: float) -> Data:
        """Return the data without this lag and the rest of the delays."""
        of_link = lag * ((_OF_LINK in self.lags) - (_OF_MOTOR in self.lags))
        of_input = 0.0 if self.lags == (_OF_LINK,) else lag
        timing = given_alignment("linear", self.drive - of_input, self.late - of_link)
        amplifier = self.corrected(lag)
        recordings = []
        for recording in self.logged.recordings:
            moved = with_velocities(aligned(amplifier.behind(recording), timing))
            ends = int(self.logged.margin / moved.sample_time)  # where derivatives are rough
            recordings.append(moved.window(ends, len(moved) - ends))
        return data_of(self.structure.joint, recordings, self.logged.groups)
