"""What an identification returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from flexid.analysis.excitation import Excitation
from flexid.identification.preparation.alignment import Alignment
from flexid.identification.preparation.joint import Kind
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import (
    CoefficientEstimate,
    Compliance,
    Disturbances,
    ModelError,
    ObserverTrace,
    ParameterEstimate,
    SegmentEvidence,
    TermEvidence,
    Validation,
    Verdict,
)
from flexid.recording.recording import Hold, Recording

Estimator = Literal["prediction-error", "innovations", "least-squares"]


@dataclass(frozen=True)
class Choices:
    """What was chosen for the user, and the evidence for it.

    Parameters
    ----------
    terms : tuple of str
        Terms of the model.
    alignment : Alignment
        Hold and delays.
    hold : {"zero", "linear", "cubic"}
        Behaviour of the input between samples.
    coulomb_velocity : float or None
        Velocity in rad/s over which Coulomb friction changes sign, if that was given; None where
        friction is dry.
    filter_rate : float
        Rate λ of the state-variable filter in 1/s.
    estimator : {"prediction-error", "innovations", "least-squares"}
        Where the coefficients come from.
    segment_duration : float or None
        Length of the segments in s; None for least squares.
    term_evidence : tuple of TermEvidence
        What the full model says of each coefficient that may be absent.
    segment_evidence : tuple of SegmentEvidence
        What each length of the segments gives.
    shapes : mapping of str to float
        Constants of the shapes of unusual terms, by name, where there are such.
    """

    terms: tuple[str, ...]
    alignment: Alignment
    hold: Hold
    coulomb_velocity: float | None
    filter_rate: float
    estimator: Estimator
    segment_duration: float | None
    term_evidence: tuple[TermEvidence, ...]
    segment_evidence: tuple[SegmentEvidence, ...]
    shapes: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Identification:
    """Everything `flexid.identification.identify.identify` finds out.

    Parameters
    ----------
    model : {"flexible", "link", "rigid"}
        What was identified: the flexible joint; its link alone where there is no input; or the
        rigid joint where there is one encoder.
    coefficients : mapping of str to CoefficientEstimate
        By name, in the model's order.
    parameters : mapping of str to ParameterEstimate
        By name.
    least_squares : mapping of str to float
        Least squares beside the estimates, by coefficient.
    excitation : mapping of str to Excitation
        By row name.
    residual_excess : mapping of str to float
        By position: residual over the noise of its sensor, as root mean squares.
    model_error : ModelError
        What the residuals say about the model.
    validation : Validation
        Free run over the held-out end of each recording, with coefficients fitted without it.
    compliance : Compliance
        Whether the log shows that the joint is flexible.
    observer : ObserverTrace
        The paper's observer over the same log.
    removed : mapping of str to ParameterEstimate
        How large parameters could be that the model does without.
    fit : Estimate
        Names, values, covariance and degrees of freedom of what was estimated.
    choices : Choices
        What was chosen, with the evidence.
    summary : tuple of str
        The choices and their reasons in three sentences.
    warnings : tuple of str
        What to know before trusting the numbers, in the order in which to act on it.
    provenance : mapping
        Version, settings, inputs with their hashes.
    recordings : tuple of Recording
        The data that it was made from; empty for what was streamed, or loaded from a file.
    disturbances : Disturbances or None
        What the drive does that no term describes; None where the exact model was fitted.
    """

    model: Kind
    coefficients: Mapping[str, CoefficientEstimate]
    parameters: Mapping[str, ParameterEstimate]
    least_squares: Mapping[str, float]
    excitation: Mapping[str, Excitation]
    residual_excess: Mapping[str, float]
    model_error: ModelError
    validation: Validation
    compliance: Compliance
    observer: ObserverTrace
    removed: Mapping[str, ParameterEstimate]
    fit: Estimate
    choices: Choices
    summary: tuple[str, ...]
    warnings: tuple[str, ...]
    provenance: Mapping[str, Any] = field(default_factory=dict)
    recordings: tuple[Recording, ...] = ()
    disturbances: Disturbances | None = None

    @property
    def verdict(self) -> Verdict:
        """The worst verdict on any parameter or coefficient."""
        found = {e.verdict for e in (*self.parameters.values(), *self.coefficients.values())}
        worst: tuple[Verdict, ...] = ("undetermined", "weak", "determined")
        return next(verdict for verdict in worst if verdict in found)

    def supports(self, *, strict: bool = False) -> bool:
        """Whether the data determine every parameter, be it weakly; if strict, not weakly."""
        return self.verdict == "determined" or (self.verdict == "weak" and not strict)
