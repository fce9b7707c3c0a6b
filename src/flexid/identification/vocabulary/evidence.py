"""What the steps of an identification find out: an estimate with its intervals, and evidence."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Self

import numpy as np
from scipy.special import stdtrit

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.cluster_covariance import shrunken


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values of what was sought, with their uncertainty."""

    names: tuple[str, ...]  # what was sought, k of them
    values: FloatArray  # (k,): their values
    # (k, k): of all that is doubted; infinite variance where the data leave a value free
    covariance: FloatArray
    degrees_of_freedom: tuple[float, ...]  # of each variance, for Student's t

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def by_name(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def of(self, name: str) -> tuple[float, float, float]:
        """Value, standard deviation and degrees of freedom of one of them."""
        place = self.names.index(name)
        std = np.sqrt(self.covariance[place, place])
        return float(self.values[place]), float(std), self.degrees_of_freedom[place]

    def scaled(self, factors: FloatArray) -> "Estimate":
        """The same with every standard deviation times a factor, shape (k,)."""
        finite = np.isfinite(np.diag(self.covariance))
        factors = np.where(finite, factors, 1.0)
        return replace(self, covariance=self.covariance * np.outer(factors, factors))

    def at_least(self, deviations: FloatArray | float) -> "Estimate":
        """The same with no standard deviation below another, shape (k,)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            short = deviations / self.deviations
        return self.scaled(np.where(np.isfinite(short), np.maximum(short, 1.0), 1.0))

    def drawn_to(self, white: FloatArray) -> "Estimate":
        """The same with the covariance drawn towards that of white noise, shape (k, k)."""
        own = np.array(self.degrees_of_freedom)
        covariance, freedom = shrunken(self.covariance, white, own)
        return replace(self, covariance=covariance, degrees_of_freedom=tuple(freedom.tolist()))

    def turned(self, mixing: FloatArray) -> "Estimate":
        """The same with errors that are a mixture, shape (k, k), of those that are finite."""
        finite = np.isfinite(np.diag(self.covariance))
        part = np.ix_(finite, finite)
        covariance = self.covariance.copy()
        covariance[part] = mixing[part] @ covariance[part] @ mixing[part].T
        return replace(self, covariance=covariance)

    def without_knowledge_of(self, names: Collection[str]) -> "Estimate":
        """The same with infinite variance for some names."""
        lost = np.array([name in names for name in self.names], dtype=np.bool_)
        covariance = np.where(lost[:, None] | lost, 0.0, self.covariance)
        covariance[lost, lost] = np.inf
        return replace(self, covariance=covariance)

    def widened(self, more: FloatArray) -> "Estimate":
        """The same with a further covariance, shape (k, k), added to what is finite."""
        finite = np.isfinite(np.diag(self.covariance))
        added = np.where(np.outer(finite, finite), more, 0.0)
        return replace(self, covariance=self.covariance + added)

    def with_values(self, known: Mapping[str, float]) -> dict[str, float]:
        """Values by name, with others that were not sought."""
        return {**known, **self.by_name}


Interval = tuple[float, float]

CONFIDENCE = 0.95
"""Nominal coverage of every interval, where no other level is asked for."""


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


_NOTHING = 6.0 * np.log(10.0)  # of a logarithm to either side: a million times as much or as little


def logarithmic_interval(
    value: float, std: float, degrees_of_freedom: float, level: float = CONFIDENCE
) -> Interval:
    """Interval of a positive quantity, symmetrical on the logarithm.

    Parameters are those of `interval`; `value` is positive. The standard deviation of the
    logarithm is `std / value` by the delta method. Ends that are many powers of ten apart say
    nothing, and are zero and infinity.
    """
    if std == 0.0:
        return value, value
    reach = quantile(degrees_of_freedom, level) * std / value
    if reach > _NOTHING:
        return 0.0, np.inf
    factor = float(np.exp(reach))
    return value / factor, value * factor


Verdict = Literal["determined", "weak", "undetermined"]


@dataclass(frozen=True)
class ValueEstimate:
    """A number with its 95 % interval and the verdict on it."""

    name: str  # name and SI unit
    unit: str  # name and SI unit
    value: float  # estimate and its standard deviation, in the unit
    std: float  # estimate and its standard deviation, in the unit
    interval: tuple[float, float]  # lower and upper end of the 95 % interval
    verdict: Verdict  # what the interval's width deserves
    # why it is not determined; of a coefficient ``"given"`` if the user gave it; else empty
    reason: str = ""
    # of the standard deviation, for Student's t
    degrees_of_freedom: float = field(default=np.inf, repr=False)
    # whether the interval is symmetrical on the logarithm
    logarithmic: bool = field(default=False, repr=False)
    # derivatives by what was fitted; empty for what was given
    slopes: Mapping[str, float] = field(default_factory=dict, repr=False)

    def __str__(self) -> str:
        low, high = self.interval
        numbers = f"{self.value:.6g} [{low:.6g}, {high:.6g}]"
        return f"{self.name} = {numbers} {self.unit}, {self.verdict}"

    @property
    def half_width(self) -> float:
        """Half of the 95 % interval, in the unit."""
        return 0.5 * (self.interval[1] - self.interval[0])

    def because(self, *reasons: str) -> Self:
        """The same with further reasons why it is not determined; as it is, if it is."""
        if self.verdict == "determined":
            return self
        return replace(self, reason="; ".join(filter(None, (self.reason, *reasons))))

    def unknown(self, reason: str) -> Self:
        """The same where nothing is known of it, whatever its interval says, and why."""
        return replace(self, verdict="undetermined", reason=reason)

    def interval_at(self, level: float) -> tuple[float, float]:
        """Interval at any level, which is a probability such as 0.99."""
        ends = logarithmic_interval if self.logarithmic else interval
        return ends(self.value, self.std, self.degrees_of_freedom, checked_level(level))


def slopes_of(values: Sequence[ValueEstimate | None], names: Sequence[str]) -> FloatArray:
    """Derivatives of values by what was fitted, shape (n_values, n_names); of none they are 0."""
    slopes = np.zeros((len(values), len(names)))
    for line, value in zip(slopes, values, strict=True):
        for name, slope in ({} if value is None else value.slopes).items():
            line[names.index(name)] = slope
    return slopes


@dataclass(frozen=True)
class FreeRun:
    """A held-out stretch and the model's free run over it."""

    time: FloatArray  # seconds on the file's clock
    measured: FloatArray  # the channels of the fit, in rad
    simulated: FloatArray  # the channels of the fit, in rad


@dataclass(frozen=True)
class Validation:
    """Free runs over data that was kept out of the fit."""

    # 100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) for link_position, motor_position and deflection; for
    # motor_position alone where the joint is rigid; for link_position and deflection where the
    # motor's measured motion drives the link
    fit_percent: Mapping[str, float]
    runs: tuple[FreeRun, ...] = ()  # one per held-out stretch
    # the same for predictions that begin again every so many seconds
    horizons: Mapping[float, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Compliance:
    """Whether a log shows that the joint is flexible."""

    visible: bool  # the answer
    reason: str  # one sentence that gives it
    deflection: float  # root mean square of the held-out deflection about its mean, rad
    deflection_noise: float  # standard deviation of the noise of the deflection, rad


@dataclass(frozen=True)
class TermEvidence:
    """What the full model says of a coefficient that may be absent, or of a delay."""

    name: str  # coefficient or delay
    kept: bool  # whether it is part of the model
    value: float  # beside all that was not taken away before it
    std: float  # beside all that was not taken away before it
    # of a value as large, were it zero; of both together, where two make one term
    probability: float


@dataclass(frozen=True)
class SegmentEvidence:
    """What one length of the segments gives."""

    duration: float  # in s
    excess: float  # mean square of the residuals over that of the sensors' noise
    # geometric mean of the relative standard deviations of inertias, stiffness and gravity
    std: float


@dataclass(frozen=True)
class ModelError:
    """What speaks for a drive that no model here describes, and what it adds to the intervals."""

    excess: float  # mean square of the residuals beyond the sensors' noise, over that of this noise
    growth: float  # power of time with which the residuals grow: 3 for white noise of the torque
    # part of them that repeats itself, from 0 to 1, and so may hide a bias of the same size
    share: float


def balance_of(coefficient: str) -> str:
    """Whose balance a coefficient stands in: the link's or the motor's."""
    return "link" if coefficient.startswith("theta") else "motor"


@dataclass(frozen=True)
class Disturbances:
    """What the drive does that no term describes, where the fit allows for it."""

    # for the link's and the motor's balance, what is left unexplained over the acceleration, as
    # root mean squares
    shares: Mapping[str, float]
    sample_time: float  # of the log in the band in which it was fitted, in s
