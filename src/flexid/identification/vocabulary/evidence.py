"""Types for the results of each step: an estimate with its intervals, and evidence."""

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
    """Estimated values with their uncertainty."""

    names: tuple[str, ...]  # k estimated coefficients and delays
    values: FloatArray  # (k,)
    # (k, k): with all doubts; a variance is infinite where the data do not determine the value
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
        """Return value, standard deviation and degrees of freedom of one name."""
        place = self.names.index(name)
        std = np.sqrt(self.covariance[place, place])
        return float(self.values[place]), float(std), self.degrees_of_freedom[place]

    def scaled(self, factors: FloatArray) -> "Estimate":
        """Return the estimate with standard deviations multiplied by `factors`, shape (k,)."""
        finite = np.isfinite(np.diag(self.covariance))
        factors = np.where(finite, factors, 1.0)
        return replace(self, covariance=self.covariance * np.outer(factors, factors))

    def at_least(self, deviations: FloatArray | float) -> "Estimate":
        """Return the estimate with standard deviations of at least `deviations`, shape (k,)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            short = deviations / self.deviations
        return self.scaled(np.where(np.isfinite(short), np.maximum(short, 1.0), 1.0))

    def drawn_to(self, white: FloatArray) -> "Estimate":
        """Return the estimate with its covariance shrunk towards `white`, shape (k, k)."""
        own = np.array(self.degrees_of_freedom)
        covariance, freedom = shrunken(self.covariance, white, own)
        return replace(self, covariance=covariance, degrees_of_freedom=tuple(freedom.tolist()))

    def turned(self, mixing: FloatArray) -> "Estimate":
        """Return the estimate with its finite errors multiplied by `mixing`, shape (k, k)."""
        finite = np.isfinite(np.diag(self.covariance))
        part = np.ix_(finite, finite)
        covariance = self.covariance.copy()
        covariance[part] = mixing[part] @ covariance[part] @ mixing[part].T
        return replace(self, covariance=covariance)

    def without_knowledge_of(self, names: Collection[str]) -> "Estimate":
        """Return the estimate with infinite variance for the given names."""
        lost = np.array([name in names for name in self.names], dtype=np.bool_)
        covariance = np.where(lost[:, None] | lost, 0.0, self.covariance)
        covariance[lost, lost] = np.inf
        return replace(self, covariance=covariance)

    def without(self, names: Collection[str]) -> "Estimate":
        """Return the estimate of the other values."""
        kept = [place for place, name in enumerate(self.names) if name not in names]
        return Estimate(
            tuple(self.names[place] for place in kept),
            self.values[kept],
            self.covariance[np.ix_(kept, kept)],
            tuple(self.degrees_of_freedom[place] for place in kept),
        )

    def widened(self, more: FloatArray) -> "Estimate":
        """Return the estimate with a covariance, shape (k, k), added where it is finite."""
        finite = np.isfinite(np.diag(self.covariance))
        added = np.where(np.outer(finite, finite), more, 0.0)
        return replace(self, covariance=self.covariance + added)

    def with_values(self, known: Mapping[str, float]) -> dict[str, float]:
        """Return values by name, together with known values that were not estimated."""
        return {**known, **self.by_name}


Interval = tuple[float, float]

CONFIDENCE = 0.95
"""Default nominal coverage of every interval."""


def checked_level(level: float) -> float:
    """Return the level as a float; raise `SettingError` if it is not between 0 and 1."""
    if not (isinstance(level, int | float) and 0.0 < level < 1.0):
        raise SettingError("level", f"must lie between 0 and 1, such as 0.95, got {level!r}")
    return float(level)


def quantile(degrees_of_freedom: float, level: float = CONFIDENCE) -> float:
    """Return the half-width in standard deviations; infinite without degrees of freedom."""
    if degrees_of_freedom <= 0.0:
        return np.inf
    return float(stdtrit(degrees_of_freedom, (1.0 + level) / 2.0))


def interval(
    value: float, std: float, degrees_of_freedom: float, level: float = CONFIDENCE
) -> Interval:
    """Return a symmetrical interval; infinite if the value is not finite."""
    if not np.isfinite(value):
        return -np.inf, np.inf
    if std == 0.0:
        return value, value
    half_width = quantile(degrees_of_freedom, level) * std
    return value - half_width, value + half_width


_WIDEST_LOGARITHM = 6.0 * np.log(10.0)  # to either side: a factor of a million


def logarithmic_interval(
    value: float, std: float, degrees_of_freedom: float, level: float = CONFIDENCE
) -> Interval:
    """Return an interval of a positive quantity, symmetrical on the logarithm.

    The parameters are the same as for `interval`; `value` is positive. By the delta method the
    standard deviation of the logarithm is `std / value`. An interval that reaches beyond a factor
    of a million is returned as zero to infinity.
    """
    if std == 0.0:
        return value, value
    reach = quantile(degrees_of_freedom, level) * std / value
    if reach > _WIDEST_LOGARITHM:
        return 0.0, np.inf
    factor = float(np.exp(reach))
    return value / factor, value * factor


Verdict = Literal["determined", "weak", "undetermined"]


@dataclass(frozen=True)
class ValueEstimate:
    """Number with its 95 % interval and its verdict."""

    name: str
    unit: str  # SI unit
    value: float  # in the unit
    std: float  # standard deviation, in the unit
    interval: tuple[float, float]  # lower and upper end of the 95 % interval
    verdict: Verdict  # judgement of the interval's width
    # reason why the value is not determined; ``"given"`` for a given coefficient; otherwise empty
    reason: str = ""
    # of the standard deviation, for Student's t
    degrees_of_freedom: float = field(default=np.inf, repr=False)
    # whether the interval is symmetrical on the logarithm
    logarithmic: bool = field(default=False, repr=False)
    # derivatives with respect to fitted coefficients, by name; empty for a given value
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
        """Return the value with further reasons; unchanged if it is determined."""
        if self.verdict == "determined":
            return self
        return replace(self, reason="; ".join(filter(None, (self.reason, *reasons))))

    def unknown(self, reason: str) -> Self:
        """Return the value as undetermined, with the reason; the interval stays."""
        return replace(self, verdict="undetermined", reason=reason)

    def interval_at(self, level: float) -> tuple[float, float]:
        """Return the interval at another level, a probability such as 0.99."""
        ends = logarithmic_interval if self.logarithmic else interval
        return ends(self.value, self.std, self.degrees_of_freedom, checked_level(level))


def slopes_of(values: Sequence[ValueEstimate | None], names: Sequence[str]) -> FloatArray:
    """Return derivatives with respect to names, shape (n_values, n_names); 0 for a None value."""
    slopes = np.zeros((len(values), len(names)))
    for line, value in zip(slopes, values, strict=True):
        for name, slope in ({} if value is None else value.slopes).items():
            line[names.index(name)] = slope
    return slopes


@dataclass(frozen=True)
class FreeRun:
    """Measured and simulated channels over one held-out end of a recording."""

    time: FloatArray  # seconds on the file's clock
    measured: FloatArray  # (n, n_channels): in rad
    simulated: FloatArray  # (n, n_channels): in rad


@dataclass(frozen=True)
class Validation:
    """Free runs over the held-out data."""

    # 100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) for link_position, motor_position and deflection; for
    # motor_position alone where the joint is rigid; for link_position and deflection where the
    # motor's measured motion drives the link
    fit_percent: Mapping[str, float]
    runs: tuple[FreeRun, ...] = ()  # one per held-out end
    # fits in per cent of predictions that restart after each horizon, by horizon in s and channel
    horizons: Mapping[float, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Compliance:
    """Whether a log shows that the joint is flexible."""

    visible: bool
    reason: str  # one sentence with the reason
    deflection: float  # root mean square of the held-out deflection about its mean, rad
    deflection_noise: float  # standard deviation of the noise of the deflection, rad


@dataclass(frozen=True)
class TermEvidence:
    """Evidence on an optional coefficient or a delay."""

    name: str  # coefficient or delay
    kept: bool  # whether the model has it
    value: float  # next to all terms that were not removed earlier
    std: float  # standard deviation of `value`
    # chance of an estimate as large if the true value is zero; joint if two coefficients make one
    # term
    probability: float


@dataclass(frozen=True)
class SegmentEvidence:
    """Fit over one length of the segments."""

    duration: float  # in s
    excess: float  # mean square of the residuals over that of the sensors' noise
    # geometric mean of the relative standard deviations of inertias, stiffness and gravity
    std: float


@dataclass(frozen=True)
class ModelError:
    """Size of the model error that the residuals show, and its effect on the intervals."""

    excess: float  # residuals' mean square over the noise's, less the part that noise explains
    growth: float  # power of time with which the residuals grow: 3 for white noise of the torque
    # share of the residuals that repeats itself, from 0 to 1; it may hide a bias of the same size
    share: float


def balance_of(coefficient: str) -> str:
    """Return the balance that a coefficient belongs to: "link" or "motor"."""
    return "link" if coefficient.startswith("theta") else "motor"


@dataclass(frozen=True)
class Disturbances:
    """Disturbances found by a fit with disturbances."""

    # root mean square of the unexplained part over the acceleration, by balance (link or motor)
    shares: Mapping[str, float]
    sample_time: float  # of the thinned log that was fitted, in s
    input_noise: float = 0.0  # noise removed from the input, in its unit; 0 if taken as logged
