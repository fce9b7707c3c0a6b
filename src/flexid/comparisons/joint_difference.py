"""Whether two estimates are of one drive: all that both hold, at once.

With d the differences of k coefficients and S = C_a + C_b,

    T² = d' S⁻¹ d

is Hotelling's. Both covariances are estimates themselves, with few degrees of freedom, so T² has
about the distribution of ν k / (ν - k + 1) times an F with k and ν - k + 1 degrees of freedom,

    ν = (k + k²) / Σ_g [tr(C_g S⁻¹ C_g S⁻¹) + tr(C_g S⁻¹)²] / ν_g

(Krishnamoorthy and Yu 2004), which no choice of units changes.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.estimate import Estimate

_MANY = 1e9  # degrees of freedom, as good as infinite


@dataclass(frozen=True)
class JointTest:
    """All coefficients of two estimates at once."""

    names: tuple[str, ...]  # those that both hold, k of them
    statistic: float  # Hotelling's T²
    degrees_of_freedom: float  # of the covariance; infinite where it is known
    probability: float  # of a T² as large for one drive, by chance
    significant: bool = False


def welch(deviations: Sequence[float], degrees_of_freedom: Sequence[float]) -> float:
    """Degrees of freedom of a sum's variance, after Welch and Satterthwaite.

    Examples
    --------
    >>> welch([1.0, 1.0], [10.0, 10.0])
    20.0
    """
    largest = max(deviations)
    variances = [(deviation / largest) ** 2 for deviation in deviations]
    each = zip(variances, degrees_of_freedom, strict=True)
    reciprocal = sum((v / sum(variances)) ** 2 / freedom for v, freedom in each)
    return 1.0 / reciprocal if reciprocal > 0.0 else np.inf


def joint_test(a: Estimate, b: Estimate, names: Collection[str]) -> JointTest | None:
    """Test whether all that two estimates hold together differs by more than chance."""
    common = [name for name in names if _known(a, name) and _known(b, name)]
    if len(common) < 2:
        return None
    of_a, of_b = _ordered(a, common), _ordered(b, common)
    return hotelling(
        tuple(common),
        of_b.values - of_a.values,
        (of_a.covariance, of_b.covariance),
        (min(of_a.degrees_of_freedom), min(of_b.degrees_of_freedom)),
    )


def hotelling(
    names: tuple[str, ...],
    difference: FloatArray,
    covariances: tuple[FloatArray, FloatArray],
    degrees_of_freedom: tuple[float, float],
) -> JointTest | None:
    """Hotelling's test of two means whose covariances differ."""
    count = len(names)
    scale = np.sqrt(np.diag(covariances[0]) + np.diag(covariances[1]))
    if not (np.isfinite(scale).all() and (scale > 0.0).all()):
        return None
    with np.errstate(all="ignore"):  # what is no number is refused below
        parts = [covariance / scale / scale[:, None] for covariance in covariances]
        distances = difference / scale
        try:
            shares = [np.linalg.solve(parts[0] + parts[1], part) for part in parts]
            statistic = float(distances @ np.linalg.solve(parts[0] + parts[1], distances))
        except np.linalg.LinAlgError:
            return None
    spent = sum(
        (float(np.trace(share @ share)) + float(np.trace(share)) ** 2) / freedom
        for share, freedom in zip(shares, degrees_of_freedom, strict=True)
    )
    freedom = (count + count**2) / spent if spent > 0.0 else np.inf
    left = freedom - count + 1.0
    if not (left >= 1.0 and 0.0 <= statistic < np.inf):
        return None
    ratio = left / freedom if np.isfinite(freedom) else 1.0
    chance = float(fdtrc(count, min(left, _MANY), statistic * ratio / count))
    return JointTest(names, statistic, freedom, chance)


def _known(fit: Estimate, name: str) -> bool:
    if name not in fit.names:
        return False
    place = fit.names.index(name)
    variance = fit.covariance[place, place]
    return bool(0.0 < variance < np.inf and fit.degrees_of_freedom[place] > 0.0)


def _ordered(fit: Estimate, names: Sequence[str]) -> Estimate:
    places = [fit.names.index(name) for name in names]
    return Estimate(
        tuple(names),
        fit.values[places],
        fit.covariance[np.ix_(places, places)],
        tuple(fit.degrees_of_freedom[place] for place in places),
    )
