"""Comparison of two estimates: differences, intervals, and tests of their significance."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, inf, isfinite, log, nan
from typing import Any, Literal

import numpy as np
from scipy.special import stdtr

import flexid
from flexid.arms.result import ArmIdentification
from flexid.errors import SettingError
from flexid.identification.result import Identification
from flexid.identification.vocabulary.evidence import CONFIDENCE, ValueEstimate, quantile
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import (
    ANGLE_ORIGIN,
    BACKLASH_WIDTH,
    CONTACT_DAMPING,
    DAMPING,
    ERROR_NUMBER,
    RIPPLE_NUMBER,
    SHAPE_TERMS,
    STRIBECK_EXPONENT,
    WIDTHS,
)
from flexid.models.physical import AMPLITUDES, ANGLES, difference
from flexid.stored_estimates.estimate_file import drive_of

Either = Identification | ArmIdentification
Values = Mapping[str, ValueEstimate]

Sharing = Literal["different", "some shared", "same"]
"""Whether two estimates were made from the same logs."""

Outcome = Literal[
    "changed",
    "perhaps changed",  # significant alone, but not after Holm's correction
    "no change",
    "contradictory",  # a significant difference, although both estimates are of the same logs
    "compatible",  # no significant difference, and both estimates are of the same logs
    "not determined",  # one of the logs does not determine it
    "not compared",  # one estimate lacks it, or its values are not comparable
]


@dataclass(frozen=True)
class Difference:
    """Difference of one parameter or coefficient between two estimates."""

    name: str
    unit: str  # in SI
    a: ValueEstimate | None  # the value in each estimate; None where the estimate lacks it
    b: ValueEstimate | None
    # "A" or "B" where the model lacks the term; its upper bound is compared instead
    without: tuple[str, ...] = ()
    value: float = nan  # B's value minus A's, in the unit; NaN if they are not compared
    interval: tuple[float, float] = (nan, nan)  # 95 % confidence interval of the difference
    percent: float = nan  # difference in per cent of A; NaN if A may be zero or is an angle
    percent_interval: tuple[float, float] = (nan, nan)
    probability: float = nan  # p-value of the difference; NaN if they are not compared
    outcome: Outcome = "not compared"
    reason: str = ""  # why the values are not compared, or one is not determined

    @property
    def compared(self) -> bool:
        """Whether the difference has a value and an interval."""
        return self.outcome not in ("not determined", "not compared")

    @property
    def largest(self) -> float:
        """Largest magnitude of a difference within the interval, in the unit."""
        return max(map(abs, self.interval))

    @property
    def largest_percent(self) -> float:
        """Largest magnitude of a difference within the interval, in per cent of A's value."""
        return max(map(abs, self.percent_interval))


@dataclass(frozen=True)
class Comparison:
    """Result of a comparison of two estimates, A and B."""

    labels: tuple[str, str]  # names of A and B: their files, if they have any
    models: tuple[str, str]  # kind of joint in each estimate
    parameters: Mapping[str, Difference]  # by name: those of A in its order, then B's others
    coefficients: Mapping[str, Difference]
    logs: Sharing  # whether both were made from the same logs
    warnings: tuple[str, ...] = ()  # limits of the comparison
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def decisive(self) -> Mapping[str, Difference]:
        """Differences of the parameters, or of the coefficients if no parameter is compared."""
        if any(d.compared for d in self.parameters.values()):
            return self.parameters
        return self.coefficients

    def having(self, *outcomes: Outcome) -> tuple[Difference, ...]:
        """Return the decisive differences with one of the given outcomes."""
        return tuple(d for d in self.decisive.values() if d.outcome in outcomes)

    @property
    def differ(self) -> bool:
        """Whether any decisive difference is significant: changed or contradictory."""
        return bool(self.having("changed", "contradictory"))

    @property
    def lacking(self) -> tuple[Difference, ...]:
        """Decisive differences that cannot be tested: one estimate leaves the value open."""
        alike = self.models[0] == self.models[1]
        return tuple(
            d
            for d in self.decisive.values()
            if d.outcome == "not determined" or (alike and (d.a is None or d.b is None))
        )

    @property
    def agree(self) -> bool:
        """Whether every common parameter was compared and none has a significant difference."""
        some = any(d.compared for d in self.decisive.values())
        return some and not self.differ and not self.lacking


def compare_estimates(a: Either, b: Either, labels: tuple[str, str] = ("A", "B")) -> Comparison:
    """Compare two estimates number by number."""
    if _same(a, b):
        raise SettingError(
            "compare",
            f"{labels[0]} and {labels[1]} are the same estimate: give two that differ in their "
            f"logs or settings",
        )
    logs = shared_logs(a.provenance, b.provenance)
    if a.model == "arm" and b.model == "arm" and a.arm.joints == b.arm.joints:
        both = (a.parameters, b.parameters)
        parameters, coefficients = _differences(both, both, logs, {}), {}
    elif a.model != "arm" and b.model != "arm":
        unlike = _unlike_constants(a, b)
        whole = ({**a.removed, **a.parameters}, {**b.removed, **b.parameters})
        parameters = _differences(whole, (a.parameters, b.parameters), logs, unlike)
        both = (a.coefficients, b.coefficients)
        # A rigid joint's coefficients have the names of other joints', but another meaning.
        alike = a.model == b.model or "rigid" not in (a.model, b.model)
        coefficients = _differences(both, both, logs, unlike) if alike else {}
    else:
        raise SettingError(
            "compare",
            f"{labels[0]} and {labels[1]} differ in their number of joints: give two estimates of "
            f"one joint, or of arms with equally many joints",
        )
    return Comparison(
        labels,
        (a.model, b.model),
        _judged(parameters, logs),
        _judged(coefficients, logs),
        logs,
        tuple(_limits(a, b, logs)),
        {"flexid_version": flexid.__version__, "a": dict(a.provenance), "b": dict(b.provenance)},
    )


def _same(a: Either, b: Either) -> bool:
    return (
        a.provenance == b.provenance
        and a.fit.names == b.fit.names
        and np.array_equal(a.fit.values, b.fit.values, equal_nan=True)
        and np.array_equal(a.fit.covariance, b.fit.covariance, equal_nan=True)
    )


def _differences(
    known: tuple[Values, Values],
    reported: tuple[Values, Values],
    logs: Sharing,
    unlike: Mapping[tuple[str, str], str],
) -> dict[str, Difference]:
    """Return the difference of each value that either estimate reports, by name."""
    found = {}
    for name in dict.fromkeys([*reported[0], *reported[1]]):
        a, b = (values.get(name) for values in known)
        pairs = zip("AB", reported, strict=True)
        without = tuple(side for side, values in pairs if name not in values)
        unit = next(value.unit for value in (a, b) if value is not None)
        found[name] = _evaluated(Difference(name, unit, a, b, without), logs, unlike)
    return found


def _evaluated(
    blank: Difference, logs: Sharing, unlike: Mapping[tuple[str, str], str]
) -> Difference:
    """Return the difference with value and interval, or with the reason why it has none."""
    a, b = blank.a, blank.b
    if a is None or b is None:
        side = "A" if a is None else "B"
        return replace(blank, reason=f"{side} lacks it, and gives no bound for it")
    if a.unit != b.unit:
        return replace(blank, reason=f"A has it in {a.unit}, B in {b.unit}")
    for (coefficient, shape), reason in unlike.items():
        own = coefficient in a.slopes or coefficient in b.slopes
        if own and not (blank.name in AMPLITUDES and shape == ANGLE_ORIGIN):
            return replace(blank, reason=reason)
    if "[" in blank.name:
        return replace(blank, reason="each log has its own value")
    for side, value in (("A", a), ("B", b)):
        if value.interval[0] == value.interval[1]:
            known = value.reason in ("", "given")
            why = "it follows from given values" if known else value.reason
            return replace(blank, reason=f"in {side} it was not estimated: {why}")
    for side, value in (("A", a), ("B", b)):
        if _is_undetermined(value):
            reason = f"in {side} {value.reason or 'it is unknown'}"
            return replace(blank, outcome="not determined", reason=reason)
    return _with_interval(blank, a, b, logs)


def _is_undetermined(value: ValueEstimate) -> bool:
    """Whether a value has no finite interval, or is undetermined for another reason than width."""
    # A value with a wide interval is compared: the difference has an interval as wide.
    half = value.half_width
    known = isfinite(half) and isfinite(value.value) and 0.0 < value.std < inf
    if not (known and value.degrees_of_freedom > 0.0):
        return True
    wide = half > THRESHOLDS.weak_width * abs(value.value)
    return value.verdict == "undetermined" and not wide


def _with_interval(
    blank: Difference, a: ValueEstimate, b: ValueEstimate, logs: Sharing
) -> Difference:
    """Return the difference with an interval about its value, or about the ratio's logarithm."""
    value = difference(blank.name, a.value, b.value)
    if a.logarithmic and b.logarithmic:
        logarithm = log(b.value) - log(a.value)
        half, probability = _significance(logarithm, a.std / a.value, b.std / b.value, a, b, logs)
        with np.errstate(over="ignore"):
            low, high = (a.value * np.expm1([logarithm - half, logarithm + half])).tolist()
        percent = 100.0 / a.value
    else:
        half, probability = _significance(value, a.std, b.std, a, b, logs)
        low, high = value - half, value + half
        nonzero = a.value != 0.0 and a.interval[0] * a.interval[1] > 0.0
        percent = 100.0 / abs(a.value) if nonzero and blank.name not in ANGLES else nan
    return replace(
        blank,
        value=value,
        interval=(low, high),
        percent=percent * value,
        percent_interval=(percent * low, percent * high),
        probability=probability,
        outcome="no change",
    )


# The difference of estimates from different logs has the variance s² = s_a² + s_b², with
# 1/ν = (s_a²/s²)²/ν_a + (s_b²/s²)²/ν_b (Welch and Satterthwaite). Estimates from one log have
# correlated errors, and the correlation is not stored: s is at most s_a + s_b.
def _significance(
    value: float, std_a: float, std_b: float, a: ValueEstimate, b: ValueEstimate, logs: Sharing
) -> tuple[float, float]:
    """Return the half-width of the difference's confidence interval, and the p-value."""
    freedom = (a.degrees_of_freedom, b.degrees_of_freedom)
    if logs == "different":
        std = hypot(std_a, std_b)
        shares = ((std_a / std) ** 2, (std_b / std) ** 2)
        spent = sum(share**2 / each for share, each in zip(shares, freedom, strict=True))
        nu = 1.0 / spent if spent > 0.0 else inf
    else:
        std, nu = std_a + std_b, min(freedom)
    return quantile(nu) * std, float(2.0 * stdtr(nu, -abs(value) / std))


def _judged(differences: Mapping[str, Difference], logs: Sharing) -> dict[str, Difference]:
    """Return the differences with outcomes, corrected for multiple comparisons (Holm)."""
    compared = [d for d in differences.values() if d.compared]
    significant = holm([d.probability for d in compared], 1.0 - CONFIDENCE)
    judged = dict(differences)
    for d, certain in zip(compared, significant, strict=True):
        outcome: Outcome = "compatible" if logs == "same" else "no change"
        if certain:
            outcome = "contradictory" if logs == "same" else "changed"
        elif logs != "same" and d.probability < 1.0 - CONFIDENCE:
            outcome = "perhaps changed"
        judged[d.name] = replace(d, outcome=outcome)
    return judged


def holm(probabilities: Sequence[float], chance: float) -> list[bool]:
    """Return which p-values are significant at the family-wise error rate `chance` (Holm)."""
    found = [False] * len(probabilities)
    for rank, place in enumerate(np.argsort(probabilities)):
        if not probabilities[place] <= chance / (len(probabilities) - rank):
            break
        found[place] = True
    return found


def shared_logs(a: Mapping[str, Any], b: Mapping[str, Any]) -> Sharing:
    """Return whether the provenances of two estimates name the same axes of the same files."""
    first, second = _named_logs(a), _named_logs(b)
    in_both = [any(_same_axis(log, other) for other in second) for log in first]
    in_both += [any(_same_axis(log, other) for other in first) for log in second]
    if not any(in_both):
        return "different"
    return "same" if all(in_both) else "some shared"


def _named_logs(provenance: Mapping[str, Any]) -> list[tuple[str, set[str]]]:
    """Return each log's digest and position columns, as one file may contain several axes."""
    found = []
    for source in provenance.get("inputs", ()):
        origins = source.get("columns", {})
        read = (origins.get(c) for c in ("motor_position", "link_position", "deflection"))
        if source.get("sha256"):
            columns = {column for origin in read if origin for column in origin["columns"]}
            found.append((source["sha256"], columns))
    return found


def _same_axis(log: tuple[str, set[str]], other: tuple[str, set[str]]) -> bool:
    """Whether two logs are of the same axis; a file without column names counts as one axis."""
    disjoint = log[1] and other[1] and not log[1] & other[1]
    return log[0] == other[0] and not disjoint


def _limits(a: Either, b: Either, logs: Sharing) -> Iterator[str]:
    """Yield a sentence for each limit of the comparison."""
    sides = {"A": a, "B": b}
    if a.model != b.model:
        yield (
            f"A is of {drive_of(a.model)} and B of {drive_of(b.model)}: only values with the same "
            f"name, meaning and unit in both are compared"
        )
    if logs == "some shared":
        yield (
            "the estimates share some logs, so their errors are correlated: the intervals assume "
            "the worst case, and a change may be missed"
        )
    unnamed = [side for side, e in sides.items() if not _named_logs(e.provenance)]
    if unnamed:
        yield (
            f"{' and '.join(unnamed)} does not name the logs it was made from: they are assumed to "
            f"be different"
        )
    known = [e.provenance.get("settings", {}).get("known", {}) for e in sides.values()]
    common = [name for name in known[0] if name in known[1]]
    if common:
        yield (
            f"both use a known value of {' and '.join(common)}: if that has changed, other values "
            f"seem to have changed instead"
        )
    unexplained = [
        side
        for side, e in sides.items()
        if (e.disturbances is not None if e.model == "arm" else e.unexplained)
    ]
    if unexplained and logs != "same":
        yield (
            f"in {' and '.join(unexplained)} the residuals contain something no term describes, "
            f"which may look like a change if the motions differ: compare logs of the same motion"
        )
    for side, estimate in sides.items():
        yield from (f"{side}: {warning}" for warning in estimate.warnings)


_LARGEST_RATIO = 2.0  # of two constants; beyond it, coefficients that depend on them differ

_OWN_RATIO = {
    RIPPLE_NUMBER: 1.02,
    ERROR_NUMBER: 1.02,
    ANGLE_ORIGIN: 1.0 + 1e-9,
    STRIBECK_EXPONENT: 1.0 + 1e-9,
}
"""Largest ratio for constants that need a tighter limit: otherwise it is another wave or law."""


def _unlike_constants(a: Identification, b: Identification) -> dict[tuple[str, str], str]:
    """Return why values of a coefficient are not comparable, by coefficient and constant."""
    regressors = [r for t in SHAPE_TERMS.values() for r in (*t.link.items(), *t.motor.items())]
    # The centre of a backlash is no such constant: the encoders' zeros may differ between logs.
    chosen = (*WIDTHS, STRIBECK_EXPONENT)
    constants = [(c, shape) for c, text in regressors for shape in chosen if shape in text]
    constants += [(coefficient, CONTACT_DAMPING) for coefficient in sorted(DAMPING)]
    found = {}
    for coefficient, shape in constants:
        first, second = (estimate.choices.shapes.get(shape) for estimate in (a, b))
        if first is None or second is None or not _differ(first, second, shape):
            continue
        if not (_is_gap(shape, a) and _is_gap(shape, b)):
            found[coefficient, shape] = (
                f"it depends on {shape}, which is {first:.5g} in A and {second:.5g} in B, chosen "
                f"for each log"
            )
    return found


def _differ(first: float, second: float, shape: str) -> bool:
    least, most = sorted((abs(first), abs(second)))
    return most > _OWN_RATIO.get(shape, _LARGEST_RATIO) * least or first * second < 0.0


def _is_gap(shape: str, estimate: Identification) -> bool:
    """Whether a constant is the width of the estimated backlash, so that it was not chosen."""
    gap = estimate.parameters.get("half_backlash")
    if shape != BACKLASH_WIDTH or gap is None:
        return False
    return not _differ(gap.value, estimate.choices.shapes[shape], shape)
