"""Numbers of two estimates: their differences with intervals, one by one and all at once.

The difference d = b - a has the variance s² = s_a² + s_b² where the logs are different ones, with

    1/ν = (s_a²/s²)²/ν_a + (s_b²/s²)²/ν_b

degrees of freedom (Welch and Satterthwaite). Where both intervals are symmetrical on the logarithm,
so is that of the difference. Estimates of one and the same log have errors in common, of which
nothing is stored; whatever these are, the deviation of d is s_a + s_b at most, and that is taken.

All at once, with d the differences of k coefficients and S = C_a + C_b,

    T² = d' S⁻¹ d

is Hotelling's. Both covariances are estimates themselves, with few degrees of freedom, so T² has
about the distribution of ν k / (ν - k + 1) times an F with k and ν - k + 1 degrees of freedom,

    ν = (k + k²) / Σ_g [tr(C_g S⁻¹ C_g S⁻¹) + tr(C_g S⁻¹)²] / ν_g

(Krishnamoorthy and Yu 2004), which no choice of units changes.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import hypot, inf, isfinite, log, nan
from typing import Literal

import numpy as np
from scipy.special import fdtrc, stdtr

from flexid.arrays import FloatArray
from flexid.identification.vocabulary.estimate import Estimate, quantile
from flexid.identification.vocabulary.evidence import ValueEstimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.physical import ANGLES, difference
from flexid.stored_estimates.estimate_origins import Sharing

Outcome = Literal[
    "changed",
    "perhaps changed",
    "no change",
    "contradictory",
    "compatible",
    "not determined",
    "not compared",
]
"""What a difference deserves.

``"perhaps changed"`` lies beyond its own interval, but so much was compared that chance may do
that. Estimates of one log, which cannot have changed, are ``"contradictory"`` or ``"compatible"``.
``"not determined"`` is what one of the logs leaves open, ``"not compared"`` what was not estimated,
or is of another kind.
"""

_NOTHING = "nothing is known of it"
COMPARED = frozenset({"changed", "perhaps changed", "no change", "contradictory", "compatible"})


@dataclass(frozen=True)
class Difference:
    """One number of both estimates."""

    name: str
    unit: str  # in SI
    a: ValueEstimate | None  # the number in each estimate; None where it has none
    b: ValueEstimate | None
    # "A" or "B" where the model does without it, and how large it could be is compared
    without: tuple[str, ...] = ()
    value: float = nan  # B's minus A's, in the unit; NaN where they are not compared
    interval: tuple[float, float] = (nan, nan)  # of the difference, at 95 %
    percent: float = nan  # the same of A's value; NaN where that may be zero, or is an angle
    percent_interval: tuple[float, float] = (nan, nan)
    probability: float = nan  # of a difference as large by chance; NaN where not compared
    outcome: Outcome = "not compared"
    reason: str = ""  # why it is not compared

    @property
    def compared(self) -> bool:
        """Whether there is a difference with an interval."""
        return self.outcome in COMPARED

    @property
    def largest(self) -> float:
        """The most that the interval allows to either side, in the unit."""
        return max(map(abs, self.interval))

    @property
    def largest_percent(self) -> float:
        """The same in per cent of A's value."""
        return max(map(abs, self.percent_interval))


def with_numbers(blank: Difference, logs: Sharing, unlike: str) -> Difference:
    """A difference with its numbers, or with the reason why it has none."""
    a, b = blank.a, blank.b
    if a is None or b is None:
        side = "A" if a is None else "B"
        return replace(blank, reason=f"{side} does without it, and does not say how large it is")
    if a.unit != b.unit:
        return replace(blank, reason=f"A has it in {a.unit}, B in {b.unit}")
    if unlike:
        return replace(blank, reason=unlike)
    if "[" in blank.name:
        return replace(blank, reason="each log has its own")
    for side, value in (("A", a), ("B", b)):
        if value.interval[0] == value.interval[1]:
            known = value.reason in ("", "given")
            why = "it follows from what was given" if known else value.reason
            return replace(blank, reason=f"in {side} it was not estimated: {why}")
    for side, value in (("A", a), ("B", b)):
        if _open(value):
            return replace(
                blank, outcome="not determined", reason=f"in {side} {value.reason or _NOTHING}"
            )
    if a.logarithmic and b.logarithmic:
        return _by_ratio(blank, a, b, logs)
    return _by_difference(blank, a, b, logs)


def _open(value: ValueEstimate) -> bool:
    """Whether the log says nothing of a value, or something else than its width speaks against it.

    A value whose interval is merely wide is compared: the interval of the difference is as wide.
    """
    half = value.half_width
    known = isfinite(half) and isfinite(value.value) and 0.0 < value.std < inf
    if not (known and value.degrees_of_freedom > 0.0):
        return True
    if value.logarithmic and not (value.value > 0.0 and 0.0 < value.std / value.value < inf):
        return True  # no file of flexid has that
    wide = half > THRESHOLDS.weak_width * abs(value.value)
    return value.verdict == "undetermined" and not wide


def _by_difference(
    blank: Difference, a: ValueEstimate, b: ValueEstimate, logs: Sharing
) -> Difference:
    """With an interval that is symmetrical about the difference."""
    value = difference(blank.name, a.value, b.value)
    reach, chance = _spread(value, a.std, b.std, a, b, logs)
    scale = abs(a.value)
    apart_from_zero = scale > 0.0 and a.interval[0] * a.interval[1] > 0.0
    relative = apart_from_zero and blank.name not in ANGLES
    percent = 100.0 / scale if relative else nan
    return replace(
        blank,
        value=value,
        interval=(value - reach, value + reach),
        percent=percent * value,
        percent_interval=(percent * (value - reach), percent * (value + reach)),
        probability=chance,
        outcome="no change",
    )


def _by_ratio(blank: Difference, a: ValueEstimate, b: ValueEstimate, logs: Sharing) -> Difference:
    """With an interval that is symmetrical about the logarithm of the ratio."""
    logarithm = log(b.value) - log(a.value)
    reach, chance = _spread(logarithm, a.std / a.value, b.std / b.value, a, b, logs)
    with np.errstate(over="ignore"):
        low, high = np.expm1([logarithm - reach, logarithm + reach]).tolist()
    change = b.value / a.value - 1.0
    return replace(
        blank,
        value=b.value - a.value,
        interval=(a.value * low, a.value * high),
        percent=100.0 * change,
        percent_interval=(100.0 * low, 100.0 * high),
        probability=chance,
        outcome="no change",
    )


def _spread(
    value: float, std_a: float, std_b: float, a: ValueEstimate, b: ValueEstimate, logs: Sharing
) -> tuple[float, float]:
    """Half the width of a difference's interval, and the chance of one as large as the value."""
    freedom = (a.degrees_of_freedom, b.degrees_of_freedom)
    if logs == "different":
        std, nu = hypot(std_a, std_b), welch((std_a, std_b), freedom)
    else:
        std, nu = std_a + std_b, min(freedom)
    return quantile(nu) * std, float(2.0 * stdtr(nu, -abs(value) / std))


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
    """Degrees of freedom of a sum's variance, after Welch and Satterthwaite."""
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
