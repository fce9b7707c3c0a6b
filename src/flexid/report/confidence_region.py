"""Joint confidence regions: what two correlated values may be together.

Two intervals side by side suggest that every pair of values within them is possible. Where the
estimates correlate that is wrong: the region of both together is a narrow ellipse across the
rectangle of the intervals, and its long axis is the combination that the log does not determine.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtri

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.estimate import Fit
from flexid.identification.vocabulary.intervals import CONFIDENCE, interval

_ANGLES = np.linspace(0.0, 2.0 * np.pi, 361)


@dataclass(frozen=True, eq=False)
class Region:
    """The joint confidence region of two values."""

    centre: FloatArray  # their estimates
    boundary: FloatArray  # the ellipse that holds both with the nominal confidence
    intervals: tuple[tuple[float, float], tuple[float, float]]  # the interval of each by itself
    correlation: float  # between the two estimates
    level: float  # the nominal confidence


def confidence_region(fit: Fit, pair: tuple[str, str], level: float = CONFIDENCE) -> Region | None:
    """Joint region of two coefficients, (p - p̂)ᵀ C⁻¹ (p - p̂) = 2 F(2, ν).

    F is Fisher's quantile, which takes the place of χ² for a covariance that is itself estimated;
    ν is the fewer degrees of freedom of the two, less one for the second dimension (Hotelling),
    and twice F is then scaled by (ν + 1) / ν.
    """
    places = [fit.names.index(name) for name in pair]
    covariance = fit.covariance[np.ix_(places, places)]
    freedom = min(fit.degrees_of_freedom[i] for i in places)
    if not np.isfinite(covariance).all() or freedom <= 1.0 or min(np.diag(covariance)) <= 0.0:
        return None
    centre = np.asarray(fit.values, dtype=np.float64)[places]
    deviations = np.sqrt(np.diag(covariance))
    correlation = float(np.clip(covariance[0, 1] / np.prod(deviations), -1.0, 1.0))
    first, second = (
        interval(float(centre[j]), float(deviations[j]), fit.degrees_of_freedom[i], level)
        for j, i in enumerate(places)
    )
    # Cholesky's factor of the correlation, written out: it serves at a correlation of 1 too.
    circle = np.array([np.cos(_ANGLES), np.sin(_ANGLES)])
    across = np.sqrt(1.0 - correlation**2)
    unit = np.array([circle[0], correlation * circle[0] + across * circle[1]])
    boundary = centre[:, None] + _radius(freedom, level) * deviations[:, None] * unit
    return Region(centre, boundary, (first, second), correlation, level)


def most_correlated(fit: Fit, among: Sequence[str]) -> tuple[str, str] | None:
    """The two of some coefficients whose estimates correlate most; None if there are not two."""
    names = [name for name in fit.names if name in among]
    places = [fit.names.index(name) for name in names]
    covariance = fit.covariance[np.ix_(places, places)]
    known = np.isfinite(np.diag(covariance)) & (np.diag(covariance) > 0.0)
    if np.sum(known) < 2:
        return None
    deviations = np.sqrt(np.where(known, np.diag(covariance), 1.0))
    correlations = np.abs(covariance) / np.outer(deviations, deviations)
    correlations[~known, :] = correlations[:, ~known] = 0.0
    np.fill_diagonal(correlations, -1.0)
    first, second = np.unravel_index(np.argmax(correlations), correlations.shape)
    return names[min(first, second)], names[max(first, second)]


def _radius(degrees_of_freedom: float, level: float) -> float:
    """Radius of the region of two values in standard deviations."""
    if np.isinf(degrees_of_freedom):
        return float(np.sqrt(-2.0 * np.log(1.0 - level)))
    left = degrees_of_freedom - 1.0
    fisher = float(fdtri(2.0, left, level))
    return float(np.sqrt(2.0 * degrees_of_freedom / left * fisher))
