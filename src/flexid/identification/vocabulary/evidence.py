"""What the steps of an identification find out, each as the reports need it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.intervals import checked_level, interval, logarithmic_interval

Verdict = Literal["determined", "weak", "undetermined"]


@dataclass(frozen=True)
class ValueEstimate:
    """A number with its 95 % interval and the verdict on it.

    Parameters
    ----------
    name, unit : str
        Name and SI unit.
    value, std : float
        Estimate and its standard deviation, in the unit.
    interval : tuple of float
        Lower and upper end of the 95 % interval.
    verdict : {"determined", "weak", "undetermined"}
        What the interval's width deserves.
    reason : str
        Why it is not determined; of a coefficient ``"given"`` if the user gave it; else empty.
    degrees_of_freedom : float
        Of the standard deviation, for Student's t.
    logarithmic : bool
        Whether the interval is symmetrical on the logarithm.
    slopes : mapping of str to float
        Derivatives by what was fitted; empty for what was given.
    """

    name: str
    unit: str
    value: float
    std: float
    interval: tuple[float, float]
    verdict: Verdict
    reason: str = ""
    degrees_of_freedom: float = field(default=np.inf, repr=False)
    logarithmic: bool = field(default=False, repr=False)
    slopes: Mapping[str, float] = field(default_factory=dict, repr=False)

    def __str__(self) -> str:
        low, high = self.interval
        numbers = f"{self.value:.6g} [{low:.6g}, {high:.6g}]"
        return f"{self.name} = {numbers} {self.unit}, {self.verdict}"

    def interval_at(self, level: float) -> tuple[float, float]:
        """Interval at any level, which is a probability such as 0.99.

        Raises
        ------
        SettingError
            If the level is none.
        """
        ends = logarithmic_interval if self.logarithmic else interval
        return ends(self.value, self.std, self.degrees_of_freedom, checked_level(level))


@dataclass(frozen=True)
class CoefficientEstimate(ValueEstimate):
    """A lumped coefficient of the model; fields are those of `ValueEstimate`."""


@dataclass(frozen=True)
class ParameterEstimate(ValueEstimate):
    """A physical parameter; fields are those of `ValueEstimate`."""


@dataclass(frozen=True)
class FreeRun:
    """A held-out stretch and the model's free run over it.

    Parameters
    ----------
    time : (n,) ndarray
        Seconds on the file's clock.
    measured, simulated : (n, n_channels) ndarray
        The channels of the fit, in rad.
    """

    time: FloatArray
    measured: FloatArray
    simulated: FloatArray


@dataclass(frozen=True)
class Validation:
    """Free runs over data that was kept out of the fit.

    Parameters
    ----------
    fit_percent : mapping of str to float
        100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) for link_position, motor_position and deflection; for
        motor_position alone where the joint is rigid; for link_position and deflection where the
        motor's measured motion drives the link.
    runs : tuple of FreeRun
        One per held-out stretch.
    horizons : mapping of float to mapping of str to float
        The same for predictions that begin anew every so many seconds.
    """

    fit_percent: Mapping[str, float]
    runs: tuple[FreeRun, ...]
    horizons: Mapping[float, Mapping[str, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class ObserverTrace:
    """Estimates of the paper's observer while the log streams by.

    Parameters
    ----------
    time : (n,) ndarray
        Seconds on the file's clock.
    names : tuple of str
        The m coefficients.
    estimates : (n, m) ndarray
        Their estimates at these times.
    gains : mapping of str to float
        The constant gain of each coefficient.
    """

    time: FloatArray
    names: tuple[str, ...]
    estimates: FloatArray
    gains: Mapping[str, float]


@dataclass(frozen=True)
class Compliance:
    """Whether a log shows that the joint is flexible.

    Parameters
    ----------
    visible : bool
        The answer.
    reason : str
        One sentence that gives it.
    rigid_fit_percent : mapping of str to float
        Free-run fit of the rigid joint, beside that of the flexible one; NaN where none was run,
        and empty where there is none to run.
    deflection : float
        Root mean square of the held-out deflection about its mean, rad.
    deflection_noise : float
        Standard deviation of the noise of the deflection, rad.
    """

    visible: bool
    reason: str
    rigid_fit_percent: Mapping[str, float]
    deflection: float
    deflection_noise: float


@dataclass(frozen=True)
class TermEvidence:
    """What the full model says of a coefficient that may be absent, or of a delay.

    Parameters
    ----------
    name : str
        Coefficient or delay.
    kept : bool
        Whether it is part of the model.
    value, std : float
        Beside all that was not taken away before it.
    probability : float
        Of a value as large, were it zero; of both together, where two make one term.
    """

    name: str
    kept: bool
    value: float
    std: float
    probability: float


@dataclass(frozen=True)
class SegmentEvidence:
    """What one length of the segments gives.

    Parameters
    ----------
    duration : float
        In s.
    excess : float
        Mean square of the residuals over that of the sensors' noise.
    std : float
        Geometric mean of the relative standard deviations of inertias, stiffness and gravity.
    """

    duration: float
    excess: float
    std: float


@dataclass(frozen=True)
class ModelError:
    """What speaks for a drive that no model here describes, and what it adds to the intervals.

    Parameters
    ----------
    excess : float
        Mean square of the residuals beyond the sensors' noise, over that of this noise.
    growth : float
        Power of time with which the residuals grow: 3 for white noise of the torque.
    share : float
        Part of them that repeats itself, from 0 to 1, and so may hide a bias of the same size.
    """

    excess: float
    growth: float
    share: float


def balance_of(coefficient: str) -> str:
    """Whose balance a coefficient stands in: the link's or the motor's."""
    return "link" if coefficient.startswith("theta") else "motor"


@dataclass(frozen=True)
class Disturbances:
    """What the drive does that no term describes, where the fit allows for it.

    Parameters
    ----------
    shares : mapping of str to float
        For the link's and the motor's balance, what is left unexplained over the acceleration, as
        root mean squares.
    sample_time : float
        Of the log in the band in which it was fitted, in s.
    """

    shares: Mapping[str, float]
    sample_time: float
