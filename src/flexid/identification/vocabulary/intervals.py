"""Intervals: of a coefficient from its standard deviation, of a physical parameter from the fit.

An estimate of a coefficient is nearly normal about the truth, so its interval is symmetrical, with
Student's t for a standard deviation that is itself estimated. A physical parameter follows from
the coefficients by the delta method, on the logarithm where that is better: where positive
coefficients enter with a negative degree in all, as in an inertia 1/beta1. The symmetrical interval
of a reciprocal is too short on its upper side; that on the logarithm is longer there and never
reaches zero. A ratio of two coefficients is skewed by its denominator one way and by its numerator
the other, and what may be zero has no logarithm: both keep the symmetrical interval.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.identification.vocabulary.estimate import Estimate
from flexid.models.flexible_joint import POSITIVE
from flexid.models.parameter_kinds import PhysicalParameter

Interval = tuple[float, float]

CONFIDENCE = 0.95
"""Nominal coverage of every interval, where no other level is asked for."""

_ROUNDING = 1e-6  # of the largest share, below which a degree is none


@dataclass(frozen=True)
class Propagated:
    """A physical parameter as a fit gives it."""

    value: float  # value and standard deviation in the parameter's unit
    std: float  # value and standard deviation in the parameter's unit
    interval: Interval  # lower and upper end of the 95 % interval
    degrees_of_freedom: float  # of the standard deviation; infinite if nothing in it was estimated
    logarithmic: bool  # whether the interval was taken on the logarithm
    slopes: Mapping[str, float]  # derivatives by what was fitted


def checked_level(level: float) -> float:
    """The level of an interval, if it is one; else a `SettingError`."""
    if not (isinstance(level, int | float) and 0.0 < level < 1.0):
        raise SettingError("level", f"must lie between 0 and 1, such as 0.95, got {level!r}")
    return float(level)


def quantile(degrees_of_freedom: float, level: float = CONFIDENCE) -> float:
    """Half-width of the interval in standard deviations; infinite without degrees of freedom."""
    if degrees_of_freedom <= 0.0:
        return np.inf
    return float(stdtrit(degrees_of_freedom, (1.0 + level) / 2.0))


def interval(
    value: float, std: float, degrees_of_freedom: float, level: float = CONFIDENCE
) -> Interval:
    """Symmetrical interval; the whole line if nothing is known."""
    if not np.isfinite(value):
        return -np.inf, np.inf
    if std == 0.0:
        return value, value
    half_width = quantile(degrees_of_freedom, level) * std
    return value - half_width, value + half_width


def logarithmic_interval(
    value: float, std: float, degrees_of_freedom: float, level: float = CONFIDENCE
) -> Interval:
    """Interval of a positive quantity, symmetrical on the logarithm.

    Parameters are those of `interval`; `value` is positive. The standard deviation of the
    logarithm is `std / value` by the delta method.
    """
    if std == 0.0:
        return value, value
    with np.errstate(over="ignore"):
        factor = float(np.exp(quantile(degrees_of_freedom, level) * std / value))
    return value / factor, value * factor


def propagated(
    parameter: PhysicalParameter, values: Mapping[str, float], fit: Estimate
) -> Propagated:
    """Physical parameter with the interval that the coefficients' covariance gives it.

    One that divides by a coefficient of zero has no value: nan.
    """
    value = parameter.value(values)
    value = value if np.isfinite(value) else np.nan
    names = tuple(name for name in fit.names if name in parameter.coefficients)
    if not names:  # follows from what was given
        return Propagated(value, 0.0, (value, value), np.inf, False, {})
    places = [fit.names.index(name) for name in names]
    gradient = parameter.gradient(values, names)
    freedom = float(min(fit.degrees_of_freedom[i] for i in places))
    std = _deviation(gradient, fit.covariance[np.ix_(places, places)])
    logarithmic = set(names) <= POSITIVE and value > 0.0 and _degree(gradient, names, values) < 0
    of = logarithmic_interval if logarithmic else interval
    slopes = dict(zip(names, gradient.tolist(), strict=True))
    return Propagated(value, std, of(value, std, freedom), freedom, logarithmic, slopes)


def _deviation(gradient: FloatArray, covariance: FloatArray) -> float:
    if not (np.isfinite(covariance).all() and np.isfinite(gradient).all()):
        return np.inf
    return float(np.sqrt(gradient @ covariance @ gradient))


def _degree(gradient: FloatArray, names: tuple[str, ...], values: Mapping[str, float]) -> int:
    """Sign of the parameter's degree in the coefficients, by Euler: g'p = degree g, with g > 0."""
    shares = gradient * [values[name] for name in names]
    degree = float(np.sum(shares))
    if not abs(degree) >= _ROUNDING * float(np.abs(shares).max()):  # nor where a coefficient is 0
        return 0
    return int(np.sign(degree))
