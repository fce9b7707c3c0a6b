"""How well a log determines each coefficient: the estimate of `identify`, and what confuses it.

Value, interval and verdict are those of the identification; added is what the other unknowns,
delays among them, cost each one.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from flexid.analysis.excitation import Excitation
from flexid.arrays import FloatArray
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import CoefficientEstimate, Verdict
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.symmetric import eigen

_DEVIATIONS = 2.0  # half the width of a predicted interval

DETERMINED_DEVIATION = THRESHOLDS.determined_width / _DEVIATIONS
"""Predicted standard deviation over the value, up to which a coefficient would be determined."""

_RANK: tuple[Verdict, ...] = ("determined", "weak", "undetermined")  # from good to bad


@dataclass(frozen=True)
class CoefficientAssessment:
    """How well one coefficient is determined."""

    name: str
    unit: str  # SI
    value: float
    std: float
    interval: tuple[float, float]  # 95 %
    verdict: Verdict
    reason: str  # why it is not determined; "given" if the user gave it; else empty
    width: float  # half the interval over the value
    width_alone: float  # the same if all other unknowns were known; NaN if it follows from others
    inflation: float  # ratio of the two
    partner: str  # the unknown whose estimate correlates the most with this one's; or empty
    correlation: float  # with the partner, -1 to 1


@dataclass(frozen=True)
class Assessment:
    """How well all coefficients are determined."""

    coefficients: Mapping[str, CoefficientAssessment]  # in the model's order
    excitation: Mapping[str, Excitation]  # by row name
    correlations: Mapping[str, Mapping[str, float]]  # of the unknowns that the log shows

    @property
    def verdict(self) -> Verdict:
        """The worst of all verdicts."""
        return _RANK[max(_RANK.index(c.verdict) for c in self.coefficients.values())]


def assess(result: Identification) -> Assessment:
    """Say of each coefficient of an identification what it is confused with."""
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
    return Assessment(coefficients, result.excitation, by_name)


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
    c: CoefficientEstimate,
    fit: Estimate,
    correlations: Mapping[str, float],
    inflation: float,
    result: Identification,
) -> CoefficientAssessment:
    half = 0.5 * (c.interval[1] - c.interval[0])
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
        name,
        c.unit,
        c.value,
        c.std,
        c.interval,
        c.verdict,
        c.reason,
        width,
        alone,
        inflation,
        partner,
        correlation,
    )


def _lost_with(name: str, rows: Mapping[str, Excitation]) -> tuple[str, float]:
    """What the regressors of its row confuse a coefficient with that the log leaves free."""
    for row in rows.values():
        if name in row.correlated:
            (other,) = (c for c in row.correlated if c != name)
            return other, row.correlation
    return "", 0.0
