"""From logs to what they determine: the work of ``flexid excitation``.

The question is that of `identify`, and so is the answer: the logs are identified, with the terms,
delays and noise that they show. What comes on top is what confuses the coefficients, and which
input would distinguish them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from flexid.analysis.excitation import Excitation
from flexid.arrays import FloatArray
from flexid.experiment_design.advice import Advice, advise
from flexid.identification.full_model.model import data_of
from flexid.identification.identify import identify
from flexid.identification.preparation.joint import joint_of
from flexid.identification.preparation.recordings import prepare
from flexid.identification.preparation.settings import Settings
from flexid.identification.result.identification import Identification
from flexid.identification.vocabulary.estimate import Estimate
from flexid.identification.vocabulary.evidence import CoefficientEstimate
from flexid.identification.vocabulary.progress import Progress, silent
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.recording.recording import Log
from flexid.symmetric import eigen

_DEVIATIONS = 2.0  # half the width of a predicted interval

DETERMINED_DEVIATION = THRESHOLDS.determined_width / _DEVIATIONS
"""Predicted standard deviation over the value, up to which a coefficient would be determined."""


@dataclass(frozen=True, kw_only=True)
class CoefficientAssessment(CoefficientEstimate):
    """How well one coefficient is determined: its estimate, and what the other unknowns cost."""

    width: float  # half the interval over the value
    width_alone: float  # the same if all other unknowns were known; NaN if it follows from others
    inflation: float  # ratio of the two
    partner: str  # the unknown whose estimate correlates the most with this one's; or empty
    correlation: float  # with the partner, -1 to 1


Correlations = Mapping[str, Mapping[str, float]]
"""Of the unknowns that the log shows."""


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
    c: CoefficientEstimate,
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
class ExcitationReport:
    """What logs determine of a joint."""

    identification: Identification
    coefficients: Mapping[str, CoefficientAssessment]  # in the model's order
    correlations: Correlations
    advice: Advice | None  # None where every coefficient is determined
    noise: Mapping[str, float]  # rad, root mean square of each position's residuals
    input_unit: str


def examine(
    logs: Sequence[Log], settings: Settings, progress: Progress = silent
) -> ExcitationReport:
    """Say how well logs determine each coefficient, and what to add where they do not."""
    result = identify(logs, settings, progress)
    recordings, _ = prepare(logs, settings.validation_share, settings.model)
    recordings = result.choices.amplifier.split_behind(recordings)
    joint = joint_of(result.model)
    data = data_of(joint, recordings.whole, recordings.groups)
    noise = data.noise * np.array(list(result.residual_excess.values()))
    progress("what to add")
    advice = advise(result, data, noise)
    return ExcitationReport(
        result,
        *assess(result),
        advice,
        dict(zip(result.residual_excess, noise.tolist(), strict=True)),
        "rad" if result.model == "link" else recordings.recorded[0].input_unit,
    )
