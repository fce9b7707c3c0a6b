"""The whole of an ``estimate.json``; null stands for a number that JSON does not have."""

from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from flexid.identification.result.identification import Estimator
from flexid.identification.vocabulary.evidence import Verdict
from flexid.stored_estimates.estimate_schema import Shapes
from flexid.stored_estimates.provenance_schema import StoredProvenance

_LARGEST = 1e50  # of what a drive may be described by, in SI units


def _of_a_drive(value: float) -> float:
    if value and not 1.0 / _LARGEST < abs(value) < _LARGEST:
        raise ValueError(f"{value:g} is no number that a drive has")
    return value


OfADrive = Annotated[float, AfterValidator(_of_a_drive)]
Fits = dict[str, float | None]
Interval = Annotated[list[float | None], Field(min_length=2, max_length=2)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", strict=True)


class StoredValue(_Part):
    """A coefficient or a parameter."""

    value: OfADrive | None
    std: float | None
    interval: Interval
    unit: str
    verdict: Verdict
    reason: str
    degrees_of_freedom: float | None
    logarithmic: bool
    slopes: dict[str, float]


class StoredFit(_Part):
    """What was fitted."""

    names: list[str]
    values: list[OfADrive | None]
    covariance: list[list[float | None]]
    degrees_of_freedom: list[float | None]

    @model_validator(mode="after")
    def _one_for_each(self) -> "StoredFit":
        count = len(self.names)
        rows = [self.values, self.degrees_of_freedom, *self.covariance]
        if len(self.covariance) != count or any(len(row) != count for row in rows):
            raise ValueError(
                f"values, freedom and covariance must have one entry for {count} names"
            )
        return self


class StoredExcitation(_Part):
    """How well the coefficients of a row are distinguished."""

    coefficients: list[str]
    singular_values: list[float]
    direction: list[float]
    level: float
    confounded: list[str]
    correlated: list[str]
    correlation: float

    @model_validator(mode="after")
    def _one_for_each(self) -> "StoredExcitation":
        count = len(self.coefficients)
        if not 0 < count == len(self.singular_values) == len(self.direction):
            raise ValueError(
                f"singular_values and direction must have one entry for {count} coefficients, and "
                f"there must be some"
            )
        if len(self.correlated) not in (0, 2):
            raise ValueError("correlated must name two coefficients, or none")
        return self


class StoredModelError(_Part):
    """What speaks against the model."""

    excess: float
    growth: float
    share: float


class StoredDisturbances(_Part):
    """`Disturbances`."""

    shares: dict[str, float]
    sample_time: float


class StoredValidation(_Part):
    """Predictions of held-out data, without their runs."""

    fit_percent: Fits
    horizons: dict[Annotated[str, Field(pattern=r"^\d+(\.\d+)?$")], Fits]

    @model_validator(mode="after")
    def _each_channel(self) -> "StoredValidation":
        for horizon, fits in self.horizons.items():
            if {*fits} != {*self.fit_percent}:
                raise ValueError(f"horizons.{horizon} must name the channels of fit_percent")
        return self


class StoredObserver(_Part):
    """The paper's observer: where it ended."""

    final: Fits
    gains: dict[str, float]


class StoredCompliance(_Part):
    """Whether the joint is seen to be flexible."""

    visible: bool
    reason: str
    rigid_fit_percent: Fits
    deflection: float | None
    deflection_noise: float | None


class StoredDelay(_Part):
    """A delay."""

    value: float
    std: float | None
    interval: Interval
    status: Literal["given", "found", "none"]


class StoredTermEvidence(_Part):
    """What the full model says of a term."""

    name: str
    kept: bool
    value: float
    std: float | None
    probability: float | None


class StoredSegmentEvidence(_Part):
    """What a length of the segments gives."""

    duration: float | None
    excess: float | None
    std: float | None


class StoredChoices(_Part):
    """What was chosen."""

    terms: list[str]
    hold: Literal["zero", "linear", "cubic"]
    hold_reason: str
    input_delay: StoredDelay
    link_delay: StoredDelay
    coulomb_velocity: float | None
    filter_rate: float
    estimator: Estimator
    segment_duration: float | None
    term_evidence: list[StoredTermEvidence]
    shapes: Shapes
    segment_evidence: list[StoredSegmentEvidence]


class StoredIdentification(_Part):
    """The whole file."""

    model: Literal["flexible", "link", "rigid"]
    coefficients: dict[str, StoredValue]
    parameters: dict[str, StoredValue]
    removed: dict[str, StoredValue]
    fit: StoredFit
    excitation: Annotated[dict[str, StoredExcitation], Field(min_length=1)]
    residual_excess: dict[str, float]
    model_error: StoredModelError
    disturbances: StoredDisturbances | None = None
    validation: StoredValidation
    observer: StoredObserver
    least_squares: dict[str, float]
    compliance: StoredCompliance
    choices: StoredChoices
    summary: list[str]
    warnings: list[str]
    provenance: StoredProvenance

    @model_validator(mode="after")
    def _known_names(self) -> "StoredIdentification":
        unknown = self.least_squares.keys() - self.coefficients.keys()
        if unknown:
            raise ValueError(f"least_squares names {min(unknown)!r}, which is no coefficient")
        for part in (self.coefficients, self.parameters):  # what was removed was not fitted
            for name, found in part.items():
                unknown = found.slopes.keys() - {*self.fit.names}
                if unknown:
                    raise ValueError(
                        f"slopes of {name} name {min(unknown)!r}, which was not fitted"
                    )
        return self
