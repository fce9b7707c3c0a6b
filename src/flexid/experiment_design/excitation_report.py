"""Excitation report: correlations between coefficients, and advice for the next motion."""

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
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import POSITIVE, resonance
from flexid.recording.recording import Log

_DEVIATIONS = 2.0  # half the width of a predicted interval

DETERMINED_DEVIATION = THRESHOLDS.determined_width / _DEVIATIONS
"""Largest predicted standard deviation, over the value, of a determined coefficient."""


@dataclass(frozen=True, kw_only=True)
class CoefficientAssessment(ValueEstimate):
    """Estimate of a coefficient, and its correlation with the other unknowns."""

    width: float  # half the interval over the value
    width_alone: float  # with all other unknowns known; NaN for a derived coefficient
    inflation: float  # ratio of the two widths
    partner: str  # unknown with the strongest correlation; or empty
    correlation: float  # with the partner, -1 to 1


Correlations = Mapping[str, Mapping[str, float]]  # of unknowns with finite variance


def assess(result: Identification) -> tuple[dict[str, CoefficientAssessment], Correlations]:
    """Return an assessment of each coefficient, and the correlations of all unknowns."""
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
        name: _assessed(name, c, by_name.get(name, {}), costs.get(name, np.inf), result)
        for name, c in result.coefficients.items()
    }
    return coefficients, by_name


def _confusion(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return correlations, and the factors by which other unknowns widen each deviation."""
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
    elif name in result.fit.names:
        partner, correlation = _partner_of(name, result.excitation)
    else:  # known, or derived from others
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


def _partner_of(name: str, rows: Mapping[str, Excitation]) -> tuple[str, float]:
    """Return the partner and the correlation of an undetermined coefficient's regressor."""
    for row in rows.values():
        if name in row.correlated:
            (other,) = (c for c in row.correlated if c != name)
            return other, row.correlation
    return "", 0.0


@dataclass(frozen=True)
class Advice:
    """Advice for the next motion."""

    resonance: float | None = None  # rad/s, where the input shows the spring best
    longer: float | None = None  # sufficient duration of the same motion in s
    caution: str = ""  # sentence on problems that another motion does not solve; or empty


_MARGIN = 1.25  # factor on the length, since the next log has other noise
_MOST_TIMES = 100.0  # longest advised duration over that of the log
# For the joint of Huang (2003), Table I, this tone brings the condition number near 1.
_RULE = (
    "The values are too uncertain for a prediction. As a rule, add a second tone at 2.65 times the "
    "frequency of the strongest one and a fifth of its amplitude, and record 5 s or more"
)


def advise(result: Identification) -> Advice | None:
    """Return advice for the next motion, or None if all coefficients are determined."""
    lacking = [c for c in result.coefficients.values() if c.verdict != "determined"]
    if not lacking:
        return None
    impossible = any(n in POSITIVE and c.value <= 0.0 for n, c in result.coefficients.items())
    if impossible or not all(isfinite(c.std) for c in lacking):
        return Advice(caution=_RULE)
    if all(verdict(c.value, c.interval)[0] == "determined" for c in lacking):
        return Advice(caution=f"Another input does not help: {lacking[0].reason}")
    # Of link against motor, or of the link alone if the motor's position is prescribed.
    found = resonance({n: c.value for n, c in result.coefficients.items()}) or None
    return Advice(found, _longer(result, lacking), _caution(result))


def _longer(result: Identification, lacking: Sequence[ValueEstimate]) -> float | None:
    """Return the sufficient duration in s, or None: more data do not cure a wrong model."""
    if result.model_error.share > 0.0 or not all(c.value for c in lacking):
        return None
    width = max(c.half_width / abs(c.value) for c in lacking)
    times = _MARGIN * (width / THRESHOLDS.determined_width) ** 2
    duration = sum(len(recording) * recording.sample_time for recording in result.recordings)
    return times * duration if times <= _MOST_TIMES else None


def _caution(result: Identification) -> str:
    """Return a sentence on a model error that widens the intervals, or empty text."""
    if result.unexplained:
        return (
            "The residuals show a part of the drive that no term here describes. It widens the "
            "intervals too: another motion narrows them less than predicted"
        )
    return ""


@dataclass(frozen=True)
class ExcitationReport:
    """Identification of a joint with the excitation of each coefficient."""

    identification: Identification
    coefficients: Mapping[str, CoefficientAssessment]  # in the model's order
    correlations: Correlations
    advice: Advice | None  # None if every coefficient is determined

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings to read before the numbers are used."""
        return self.identification.warnings

    def supports(self, *, strict: bool = False) -> bool:
        """Whether the worst verdict is determined or weak; if `strict`, whether it is determined.

        As in `Identification.verdict`, unusual terms that nobody asked for do not count.
        """
        return self.identification.supports(strict=strict)


def examine(
    logs: Sequence[Log], settings: Settings, progress: Progress = silent
) -> ExcitationReport:
    """Identify a joint, assess how well each coefficient is determined, and give advice."""
    result = identify(logs, settings, progress)
    return ExcitationReport(result, *assess(result), advise(result))
