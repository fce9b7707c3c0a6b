"""What the steps of an identification find out, each as the reports need it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, Self

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.estimate import checked_level, interval, logarithmic_interval

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
class CoefficientEstimate(ValueEstimate):
    """A lumped coefficient of the model; fields are those of `ValueEstimate`."""


@dataclass(frozen=True)
class ParameterEstimate(ValueEstimate):
    """A physical parameter; fields are those of `ValueEstimate`."""


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
