"""What confuses the coefficients of an identification, and what the next motion needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.excitation import Excitation
from flexid.estimators.normal_equations import eigen
from flexid.identification.identify import identify
from flexid.identification.judgement import verdict
from flexid.identification.preparation.settings import Settings
from flexid.identification.result import Identification
from flexid.identification.vocabulary import Progress, silent
from flexid.identification.vocabulary.evidence import Estimate, ValueEstimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import POSITIVE, resonance
from flexid.recording.recording import Log

_DEVIATIONS = 2.0  # half the width of a predicted interval

DETERMINED_DEVIATION = THRESHOLDS.determined_width / _DEVIATIONS
"""Predicted standard deviation over the value, up to which a coefficient would be determined."""


@dataclass(frozen=True, kw_only=True)
class CoefficientAssessment(ValueEstimate):
    """How well one coefficient is determined: its estimate, and what the other unknowns cost."""

    width: float  # half the interval over the value
    width_alone: float  # the same if all other unknowns were known; NaN if it follows from others
    inflation: float  # ratio of the two
    partner: str  # the unknown whose estimate correlates the most with this one's; or empty
    correlation: float  # with the partner, -1 to 1


Correlations = Mapping[str, Mapping[str, float]]  # of the unknowns that the log shows


def assess(result: Identification) -> tuple[dict[str, CoefficientAssessment], Correlations]:
    """What each coefficient of an identification is confused with, and all correlations."""
    fit = result.fit
    finite = np.isfinite(np.diag(fit.covariance))
    names = tuple(n for n, usable in zip(fit.names, finite, strict=True) if usable)
    correlations, inflation = _confusion(fit.covariance[np.ix_(finite, finite)])
    by_name = {
        name: dict(zip(names, line, strict=True))
        for name, line in zip(names, correlations.tolist(), strict=True)
    }
    costs = dict(zip(names, inflation.tolist(), strict=True))
    coefficients = {
        name: _assessed(name, c, fit, by_name.get(name, {}), costs.get(name, np.inf), result)
        for name, c in result.coefficients.items()
    }
    return coefficients, by_name


def _confusion(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Correlations, and by how much the others widen each standard deviation."""
    deviations = np.sqrt(np.diag(covariance))
    scale = np.where(deviations > 0.0, deviations, 1.0)
    correlations = covariance / np.outer(scale, scale)
    if not len(scale):
        return correlations, deviations
    eigenvalues, vectors = eigen(correlations)
    floor = np.finfo(float).eps * eigenvalues[-1]
    inverse = (vectors / np.maximum(eigenvalues, floor)) @ vectors.T
    return correlations, np.sqrt(np.maximum(np.diag(inverse), 1.0))


def _assessed(
    name: str,
    c: ValueEstimate,
    fit: Estimate,
    correlations: Mapping[str, float],
    inflation: float,
    result: Identification,
) -> CoefficientAssessment:
    half = c.half_width
    width = half / abs(c.value) if c.value else (0.0 if half == 0.0 else np.inf)
    alone, partner, correlation = np.nan, "", 0.0
    if name in correlations:
        alone = width / inflation
        others = {other: r for other, r in correlations.items() if other != name}
        if others:
            partner = max(others, key=lambda other: abs(others[other]))
            correlation = others[partner]
    elif name in fit.names:
        partner, correlation = _lost_with(name, result.excitation)
    else:  # given, or it follows from others
        inflation = 1.0
        alone = 0.0 if half == 0.0 else np.nan
    return CoefficientAssessment(
        **vars(c),
        width=width,
        width_alone=alone,
        inflation=inflation,
        partner=partner,
        correlation=correlation,
    )


def _lost_with(name: str, rows: Mapping[str, Excitation]) -> tuple[str, float]:
    """What the regressors of its row confuse a coefficient with that the log leaves free."""
    for row in rows.values():
        if name in row.correlated:
            (other,) = (c for c in row.correlated if c != name)
            return other, row.correlation
    return "", 0.0


@dataclass(frozen=True)
class Advice:
    """What the next motion should have more of."""

    resonance: float | None = None  # rad/s, near which a part of the input tells most of the spring
    longer: float | None = None  # s of the same motion that suffice
    caution: str = ""  # a sentence on what another motion does not mend; or empty


_MARGIN = 1.25  # on the length: the next log has other noise
_MOST_TIMES = 100.0  # the length of the log
# This brings the condition number of the joint of Huang (2003), Table I, near 1.
_NO_MODEL = (
    "The values themselves are lost. As a rule, add a second tone at 2.65 times the frequency of "
    "the strongest one and a fifth of its amplitude, record 5 s or more, look again"
)


def advise(result: Identification) -> Advice | None:
    """Say what the next motion should have more of; None where everything is determined."""
    lacking = [c for c in result.coefficients.values() if c.verdict != "determined"]
    if not lacking:
        return None
    impossible = any(n in POSITIVE and c.value <= 0.0 for n, c in result.coefficients.items())
    if impossible or not all(isfinite(c.std) for c in lacking):
        return Advice(caution=_NO_MODEL)
    if all(verdict(c.value, c.interval)[0] == "determined" for c in lacking):
        return Advice(caution=f"Another input does not help: {lacking[0].reason}")
    # Of link and motor against each other; of the link alone where its motor is driven.
    found = resonance({n: c.value for n, c in result.coefficients.items()}) or None
    return Advice(found, _longer(result, lacking), _caution(result))


def _longer(result: Identification, lacking: Sequence[ValueEstimate]) -> float | None:
    """Seconds of the same motion that suffice; a wrong model stays wrong however long."""
    if result.model_error.share > 0.0 or not all(c.value for c in lacking):
        return None
    width = max(c.half_width / abs(c.value) for c in lacking)
    times = _MARGIN * (width / THRESHOLDS.determined_width) ** 2
    duration = sum(len(recording) * recording.sample_time for recording in result.recordings)
    return times * duration if times <= _MOST_TIMES else None


def _caution(result: Identification) -> str:
    """What widens the intervals though the motion would do."""
    if result.unexplained:
        return (
            "The residuals show a part of the drive that no term here describes. It widens the "
            "intervals too: another motion narrows them less than predicted"
        )
    return ""


@dataclass(frozen=True)
class ExcitationReport:
    """What logs determine of a joint."""

    identification: Identification
    coefficients: Mapping[str, CoefficientAssessment]  # in the model's order
    correlations: Correlations
    advice: Advice | None  # None where every coefficient is determined


def examine(
    logs: Sequence[Log], settings: Settings, progress: Progress = silent
) -> ExcitationReport:
    """Say how well logs determine each coefficient, and what is lacking where they do not."""
    result = identify(logs, settings, progress)
    return ExcitationReport(result, *assess(result), advise(result))
