"""What an identification returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexid.analysis.excitation import Excitation
from flexid.recording.recording import Hold

Status = Literal["determined", "weak", "undetermined"]

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
    measured, simulated : (n, 3) ndarray
        Link position, motor position and deflection in rad.
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
        100 (1 - ‖y - ŷ‖ / ‖y - ȳ‖) for link_position, motor_position and deflection.
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
class Identification:
    """Everything `flexid.identification.identify.identify` finds out.

    Parameters
    ----------
    coefficients : mapping of str to CoefficientEstimate
        By name, in the model's order.
    parameters : mapping of str to ParameterEstimate
        By name.
    excitation : mapping of str to Excitation
        By row name.
    residual_excess : mapping of str to float
        By row name: residual over what the noise of the positions explains, as root mean squares.
    validation : Validation
        Free run over the held-out end of each piece, with coefficients fitted without it.
    observer : ObserverTrace
        The paper's observer over the same log.
    hold : {"zero", "linear"}
        Behaviour of the input between samples that fits the log.
    filter_rate : float
        Rate λ of the state-variable filter in 1/s.
    warnings : tuple of str
        Everything the user should know before trusting the numbers.
    provenance : mapping
        Version, settings, inputs with their hashes.
    """

    coefficients: Mapping[str, CoefficientEstimate]
    parameters: Mapping[str, ParameterEstimate]
    excitation: Mapping[str, Excitation]
    residual_excess: Mapping[str, float]
    validation: Validation
    observer: ObserverTrace
    hold: Hold
    filter_rate: float
    warnings: tuple[str, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def supported(self) -> bool:
        """Whether the data can tell every coefficient."""
        return all(c.status != "undetermined" for c in self.coefficients.values())
