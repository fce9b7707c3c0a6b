"""Files that hold an identification: read, checked for their version, made a result once more."""

import json
from collections.abc import Mapping
from functools import partial
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from flexid.errors import SettingError
from flexid.files import read_bytes
from flexid.toml_file import Refuse, validated

if TYPE_CHECKING:
    from flexid.identification.result.identification import Choices, Identification
    from flexid.identification.vocabulary.evidence import ValueEstimate
    from flexid.stored_estimates.identification_schema import (
        StoredDelay,
        StoredIdentification,
        StoredValue,
    )

FORMAT_VERSION = 1
"""Of the files that this version writes, and the newest that it reads."""

LARGEST_FILE = 20_000_000  # bytes; an estimate of many logs has some values for each

USUAL_NAME = "estimate.json"
"""Of the file in a folder that ``flexid identify --out`` wrote."""

WANTED = "an estimate.json of flexid identify"

_Value = TypeVar("_Value", bound="ValueEstimate")


class EstimateFile(NamedTuple):
    """An estimate as it is stored."""

    name: str  # the file, for messages
    raw: bytes  # its text
    content: dict[str, Any]  # what that says

    @property
    def refuse(self) -> Refuse:
        """Makes an error of a key of this file and a reason."""
        return lambda key, reason: SettingError(
            self.name, f"the key {key!r} {reason}" if key else reason
        )


def read_estimate(estimate: Path | str | Mapping[str, Any]) -> EstimateFile:
    """Read a stored estimate."""
    if isinstance(estimate, Mapping):
        raw = json.dumps(estimate, default=str).encode()
        return _checked(EstimateFile("estimate", raw, dict(estimate)))
    path = Path(estimate)
    if path.is_dir():
        path = path / USUAL_NAME
    file = EstimateFile(str(path), b"", {})
    raw = read_bytes(path, LARGEST_FILE, WANTED, partial(file.refuse, ""))
    try:
        content = json.loads(raw.decode("utf-8"))
    except (ValueError, RecursionError):
        raise file.refuse("", f"is no JSON: give {WANTED}") from None
    return _checked(EstimateFile(file.name, raw, content))


def _checked(file: EstimateFile) -> EstimateFile:
    version = file.content.get("format_version") if isinstance(file.content, dict) else None
    if isinstance(version, bool) or not isinstance(version, int):
        raise file.refuse("", f"holds no estimate: give {WANTED}")
    if version > FORMAT_VERSION:
        raise file.refuse(
            "",
            f"is of format {version}, and this version of flexid reads up to {FORMAT_VERSION}: "
            f"update flexid",
        )
    return file


def stored_identification(file: EstimateFile) -> "Identification":
    """The identification that a file holds; its time series, which are not stored, are empty."""
    from flexid.analysis.excitation import Excitation
    from flexid.identification.result.identification import Identification
    from flexid.identification.vocabulary.estimate import Estimate
    from flexid.identification.vocabulary.evidence import (
        CoefficientEstimate,
        Compliance,
        Disturbances,
        ModelError,
        ObserverTrace,
        ParameterEstimate,
        Validation,
    )
    from flexid.stored_estimates.identification_schema import StoredIdentification

    stored = validated(file.content, StoredIdentification, file.refuse)
    validation = stored.validation
    return Identification(
        model=stored.model,
        coefficients=_values(CoefficientEstimate, stored.coefficients),
        parameters=_values(ParameterEstimate, stored.parameters),
        least_squares=stored.least_squares,
        excitation={
            row: Excitation(
                row,
                tuple(e.coefficients),
                np.array(e.singular_values),
                e.level,
                tuple(e.confounded),
                np.array(e.direction),
                e.correlation,
                tuple(e.correlated),
            )
            for row, e in stored.excitation.items()
        },
        residual_excess=stored.residual_excess,
        model_error=ModelError(**stored.model_error.model_dump()),
        validation=Validation(
            _known(validation.fit_percent),
            (),
            {float(horizon): _known(fits) for horizon, fits in validation.horizons.items()},
        ),
        compliance=Compliance(
            stored.compliance.visible,
            stored.compliance.reason,
            _known(stored.compliance.rigid_fit_percent),
            _number(stored.compliance.deflection, nan),
            _number(stored.compliance.deflection_noise, nan),
        ),
        observer=ObserverTrace(
            np.empty(0),
            tuple(stored.observer.final),
            np.empty((0, len(stored.observer.final))),
            stored.observer.gains,
        ),
        removed=_values(ParameterEstimate, stored.removed),
        fit=Estimate(
            tuple(stored.fit.names),
            np.array([_number(x, nan) for x in stored.fit.values]),
            np.array([[_number(x, inf) for x in line] for line in stored.fit.covariance]),
            tuple(_number(x, inf) for x in stored.fit.degrees_of_freedom),
        ),
        choices=_choices(stored),
        summary=tuple(stored.summary),
        warnings=tuple(stored.warnings),
        provenance=file.content["provenance"],  # whole; the schema has what is read of it
        disturbances=Disturbances(**stored.disturbances.model_dump())
        if stored.disturbances
        else None,
    )


def _number(value: float | None, missing: float) -> float:
    """A number; one that JSON does not have stands there as null."""
    return missing if value is None else value


def _known(numbers: Mapping[str, float | None]) -> dict[str, float]:
    return {name: _number(value, nan) for name, value in numbers.items()}


def _values(kind: type[_Value], stored: "Mapping[str, StoredValue]") -> dict[str, _Value]:
    return {
        name: kind(
            name,
            e.unit,
            _number(e.value, nan),
            _number(e.std, inf),
            (_number(e.interval[0], -inf), _number(e.interval[1], inf)),
            e.verdict,
            e.reason,
            _number(e.degrees_of_freedom, inf),
            e.logarithmic,
            e.slopes,
        )
        for name, e in stored.items()
    }


def _choices(stored: "StoredIdentification") -> "Choices":
    from flexid.identification.preparation.alignment import Alignment, Delay
    from flexid.identification.result.identification import Choices
    from flexid.identification.vocabulary.evidence import SegmentEvidence, TermEvidence

    def delay(found: "StoredDelay") -> Delay:
        ends = (_number(found.interval[0], -inf), _number(found.interval[1], inf))
        return Delay(found.value, _number(found.std, inf), ends, found.status)

    made = stored.choices
    return Choices(
        terms=tuple(made.terms),
        alignment=Alignment(
            made.hold, delay(made.input_delay), delay(made.link_delay), made.hold_reason
        ),
        hold=made.hold,
        coulomb_velocity=made.coulomb_velocity,
        filter_rate=made.filter_rate,
        estimator=made.estimator,
        segment_duration=made.segment_duration,
        term_evidence=tuple(
            TermEvidence(e.name, e.kept, e.value, _number(e.std, inf), _number(e.probability, nan))
            for e in made.term_evidence
        ),
        segment_evidence=tuple(
            SegmentEvidence(*(_number(x, nan) for x in (e.duration, e.excess, e.std)))
            for e in made.segment_evidence
        ),
        shapes=made.shapes,
    )
