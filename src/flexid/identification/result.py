"""What an identification returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexid.analysis.excitation import Excitation
from flexid.identification.alignment import Alignment
from flexid.identification.intervals import Fitted
from flexid.identification.joint import Kind
from flexid.recording.recording import Hold

Status = Literal["determined", "weak", "undetermined"]

Estimator = Literal["prediction-error", "least-squares"]

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class CoefficientEstimate:
    """A lumped coefficient with its 95 % interval and the verdict on it.

    Parameters
    ----------
    name, unit : str
        Name in the model and SI unit.
    value, std : float
        Estimate and its standard deviation, in the unit.
    interval : tuple of float
        Lower and upper end of the 95 % interval.
    status : {"determined", "weak", "undetermined"}
        The verdict.
    reason : str
        Why it is not determined; ``"given"`` if the user gave it; else empty.
    """

    name: str
    unit: str
    value: float
    std: float
    interval: tuple[float, float]
    status: Status
    reason: str = ""


@dataclass(frozen=True)
class ParameterEstimate:
    """A physical parameter with its 95 % interval; it is as well determined as its coefficients."""

    name: str
    unit: str
    value: float
    std: float
    interval: tuple[float, float]
    status: Status


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
        100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) for link_position, motor_position and deflection, or for
        motor_position alone where the joint is rigid.
    runs : tuple of FreeRun
        One per held-out stretch.
    """

    fit_percent: Mapping[str, float]
    runs: tuple[FreeRun, ...]


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
        Free-run fit of the rigid joint, beside that of the flexible one; NaN where none was run.
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
    """What a term buys.

    Parameters
    ----------
    term : str
        Its name.
    chosen : bool
        Whether it is part of the model.
    with_term, without_term : float
        Error of the free run, relative to the motion, with it and without it.
    """

    term: str
    chosen: bool
    with_term: float
    without_term: float


@dataclass(frozen=True)
class SegmentEvidence:
    """What one length of the segments gives.

    Parameters
    ----------
    duration : float
        In s; 0 stands for least squares without any.
    error : float
        Error of the free run relative to the motion.
    converged : bool
        Whether prediction error did; if not, least squares ran in its place. True without segments.
    """

    duration: float
    error: float
    converged: bool


@dataclass(frozen=True)
class Choices:
    """What was chosen for the user, and the evidence for it.

    Parameters
    ----------
    terms : tuple of str
        Terms of the model.
    alignment : Alignment
        Hold and delays.
    hold : {"zero", "linear"}
        Behaviour of the input between samples.
    coulomb_velocity : float or None
        Velocity in rad/s over which Coulomb friction changes sign; None where there is none.
    stopping_time : float or None
        Time in s in which friction brings the motor to rest; None without ``motor_stiction``.
    filter_rate : float
        Rate λ of the state-variable filter in 1/s.
    estimator : {"prediction-error", "least-squares"}
        Where the coefficients come from.
    segment_duration : float or None
        Length of the segments in s; None for least squares.
    term_evidence : tuple of TermEvidence
        What each term buys; empty where the user gave the terms.
    segment_evidence : tuple of SegmentEvidence
        What each length of the segments gives.
    """

    terms: tuple[str, ...]
    alignment: Alignment
    hold: Hold
    coulomb_velocity: float | None
    stopping_time: float | None
    filter_rate: float
    estimator: Estimator
    segment_duration: float | None
    term_evidence: tuple[TermEvidence, ...]
    segment_evidence: tuple[SegmentEvidence, ...]


@dataclass(frozen=True)
class Identification:
    """Everything `flexid.identification.identify.identify` finds out.

    Parameters
    ----------
    model : {"flexible", "rigid"}
        What was identified: the flexible joint, or the rigid one where there is one encoder.
    coefficients : mapping of str to CoefficientEstimate
        By name, in the model's order.
    parameters : mapping of str to ParameterEstimate
        By name.
    least_squares : mapping of str to float
        Least squares beside the estimates, by coefficient.
    excitation : mapping of str to Excitation
        By row name.
    residual_excess : mapping of str to float
        By row name: residual over what the noise of the positions explains, as root mean squares.
    validation : Validation
        Free run over the held-out end of each piece, with coefficients fitted without it.
    compliance : Compliance
        Whether the log shows that the joint is flexible.
    observer : ObserverTrace
        The paper's observer over the same log.
    fit : Fitted
        Names, values, covariance and degrees of freedom of what was estimated.
    choices : Choices
        What was chosen, with the evidence.
    summary : tuple of str
        The choices and their reasons in three sentences.
    warnings : tuple of str
        Everything the user should know before trusting the numbers.
    provenance : mapping
        Version, settings, inputs with their hashes.
    """

    model: Kind
    coefficients: Mapping[str, CoefficientEstimate]
    parameters: Mapping[str, ParameterEstimate]
    least_squares: Mapping[str, float]
    excitation: Mapping[str, Excitation]
    residual_excess: Mapping[str, float]
    validation: Validation
    compliance: Compliance
    observer: ObserverTrace
    fit: Fitted
    choices: Choices
    summary: tuple[str, ...]
    warnings: tuple[str, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def supported(self) -> bool:
        """Whether the data can tell every coefficient."""
        return all(c.status != "undetermined" for c in self.coefficients.values())
