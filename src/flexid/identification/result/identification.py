"""What an identification returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from flexid.analysis.excitation import Excitation
from flexid.identification.full_model.amplifier import IDEAL, Amplifier
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
    """What was chosen for the user, and the evidence for it."""

    terms: tuple[str, ...]  # terms of the model
    alignment: Alignment  # hold and delays
    hold: Hold  # behaviour of the input between samples
    # velocity in rad/s over which Coulomb friction changes sign, if that was given; None where
    # friction is dry
    coulomb_velocity: float | None
    filter_rate: float  # rate λ of the state-variable filter in 1/s
    estimator: Estimator  # where the coefficients come from
    segment_duration: float | None  # length of the segments in s; None for least squares
    # what the full model says of each coefficient that may be absent
    term_evidence: tuple[TermEvidence, ...]
    segment_evidence: tuple[SegmentEvidence, ...]  # what each length of the segments gives
    # constants of the shapes of unusual terms, by name, where there are such
    shapes: Mapping[str, float] = field(default_factory=dict)
    amplifier: Amplifier = IDEAL  # what became of the logged voltage before it reached the motor


@dataclass(frozen=True)
class Identification:
    """Everything `flexid.identification.identify.identify` finds out."""

    # what was identified: the flexible joint; its link alone where there is no input; or the rigid
    # joint where there is one encoder
    model: Kind
    coefficients: Mapping[str, CoefficientEstimate]  # by name, in the model's order
    parameters: Mapping[str, ParameterEstimate]  # by name
    least_squares: Mapping[str, float]  # least squares beside the estimates, by coefficient
    excitation: Mapping[str, Excitation]  # by row name
    # by position: residual over the noise of its sensor, as root mean squares
    residual_excess: Mapping[str, float]
    model_error: ModelError  # what the residuals say about the model
    # free run over the held-out end of each recording, with coefficients fitted without it
    validation: Validation
    compliance: Compliance  # whether the log shows that the joint is flexible
    observer: ObserverTrace  # the paper's observer over the same log
    # how large parameters could be that the model does without
    removed: Mapping[str, ParameterEstimate]
    fit: Estimate  # names, values, covariance and degrees of freedom of what was estimated
    choices: Choices  # what was chosen, with the evidence
    summary: tuple[str, ...]  # the choices and their reasons in three sentences
    # what to know before trusting the numbers, in the order in which to act on it
    warnings: tuple[str, ...]
    # version, settings, inputs with their hashes
    provenance: Mapping[str, Any] = field(default_factory=dict)
    # the data that it was made from; empty for what was streamed, or loaded from a file
    recordings: tuple[Recording, ...] = ()
    # what the drive does that no term describes; None where the exact model was fitted
    disturbances: Disturbances | None = None

    @property
    def verdict(self) -> Verdict:
        """The worst verdict on any parameter or coefficient."""
        found = {e.verdict for e in (*self.parameters.values(), *self.coefficients.values())}
        worst: tuple[Verdict, ...] = ("undetermined", "weak", "determined")
        return next(verdict for verdict in worst if verdict in found)

    @property
    def given(self) -> frozenset[str]:
        """Coefficients that were not estimated."""
        found = self.coefficients.items()
        return frozenset(name.partition("[")[0] for name, c in found if c.std == 0.0)

    @property
    def input_unit(self) -> str:
        """Unit of the input; empty for the link alone."""
        gain = self.coefficients.get("beta1")
        return "" if gain is None else gain.unit.removeprefix("rad/s^2/").strip("()")

    def supports(self, *, strict: bool = False) -> bool:
        """Whether the data determine every parameter, be it weakly; if strict, not weakly."""
        return self.verdict == "determined" or (self.verdict == "weak" and not strict)
