"""Two estimates side by side: what differs, and whether chance explains it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
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
    BACKLASH_WIDTH,
    RIPPLE_NUMBER,
    RIPPLE_ORIGIN,
    SHAPE_TERMS,
    WIDTHS,
)
from flexid.models.physical import ANGLES, difference

Either = Identification | ArmIdentification
Values = Mapping[str, ValueEstimate]

Sharing = Literal["different", "some shared", "same"]
"""Whether two estimates were made from the same logs."""

Outcome = Literal[
    "changed",
    "perhaps changed",  # beyond its own interval, but among so many chance may do that
    "no change",
    "contradictory",  # of one log, in which nothing can have changed
    "compatible",  # of one log, too
    "not determined",  # one of the logs leaves it open
    "not compared",  # it was not estimated, or is of another kind
]


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
        return self.outcome not in ("not determined", "not compared")

    @property
    def largest(self) -> float:
        """The most that the interval allows to either side, in the unit."""
        return max(map(abs, self.interval))

    @property
    def largest_percent(self) -> float:
        """The same in per cent of A's value."""
        return max(map(abs, self.percent_interval))


@dataclass(frozen=True)
class Comparison:
    """Two estimates side by side."""

    labels: tuple[str, str]  # what A and B are called: their files, if they have any
    models: tuple[str, str]  # which joint was identified in each
    parameters: Mapping[str, Difference]  # by name, in the order of A, then what B has beside that
    coefficients: Mapping[str, Difference]
    logs: Sharing  # whether both were made from the same logs
    warnings: tuple[str, ...] = ()  # what limits the comparison
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def decisive(self) -> Mapping[str, Difference]:
        """What the answer rests on: the parameters, or where none is compared the coefficients."""
        if any(d.compared for d in self.parameters.values()):
            return self.parameters
        return self.coefficients

    def having(self, *outcomes: Outcome) -> tuple[Difference, ...]:
        """Decisive differences with one of some outcomes."""
        return tuple(d for d in self.decisive.values() if d.outcome in outcomes)

    @property
    def differ(self) -> bool:
        """Whether a change is established, or a contradiction."""
        return bool(self.having("changed", "contradictory"))

    @property
    def lacking(self) -> tuple[Difference, ...]:
        """What one of the logs leaves open, so that nobody knows whether it has changed."""
        alike = self.models[0] == self.models[1]
        return tuple(
            d
            for d in self.decisive.values()
            if d.outcome == "not determined" or (alike and (d.a is None or d.b is None))
        )

    @property
    def agree(self) -> bool:
        """Whether all that is in both drives was compared, and no change is established."""
        some = any(d.compared for d in self.decisive.values())
        return some and not self.differ and not self.lacking


def compare_estimates(a: Either, b: Either, labels: tuple[str, str] = ("A", "B")) -> Comparison:
    """Compare two estimates number by number."""
    if _same(a, b):
        raise SettingError(
            "compare",
            f"{labels[0]} and {labels[1]} hold the same estimate: give two that differ in their "
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
        # Coefficients of a rigid joint are named as others, and mean something else.
        alike = a.model == b.model or "rigid" not in (a.model, b.model)
        coefficients = _differences(both, both, logs, unlike) if alike else {}
    else:
        raise SettingError(
            "compare",
            f"{labels[0]} and {labels[1]} are not of the same number of joints: give two estimates "
            f"of one joint, or two of arms with as many joints",
        )
    return Comparison(
        labels,
        (a.model, b.model),
        _judged(parameters, logs),
        _judged(coefficients, logs),
        logs,
        tuple(_doubts(a, b, logs)),
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
    """Differences of all that either model has, by name."""
    found = {}
    for name in dict.fromkeys([*reported[0], *reported[1]]):
        a, b = (values.get(name) for values in known)
        pairs = zip("AB", reported, strict=True)
        without = tuple(side for side, values in pairs if name not in values)
        unit = next(value.unit for value in (a, b) if value is not None)
        found[name] = _with_numbers(Difference(name, unit, a, b, without), logs, unlike)
    return found


def _with_numbers(
    blank: Difference, logs: Sharing, unlike: Mapping[tuple[str, str], str]
) -> Difference:
    """A difference with its numbers, or with the reason why it has none."""
    a, b = blank.a, blank.b
    if a is None or b is None:
        side = "A" if a is None else "B"
        return replace(blank, reason=f"{side} does without it, and does not say how large it is")
    if a.unit != b.unit:
        return replace(blank, reason=f"A has it in {a.unit}, B in {b.unit}")
    if reason := _unlike_reason(blank.name, {**a.slopes, **b.slopes}, unlike):
        return replace(blank, reason=reason)
    if "[" in blank.name:
        return replace(blank, reason="each log has its own")
    for side, value in (("A", a), ("B", b)):
        if value.interval[0] == value.interval[1]:
            known = value.reason in ("", "given")
            why = "it follows from what was given" if known else value.reason
            return replace(blank, reason=f"in {side} it was not estimated: {why}")
    for side, value in (("A", a), ("B", b)):
        if _is_open(value):
            reason = f"in {side} {value.reason or 'nothing is known of it'}"
            return replace(blank, outcome="not determined", reason=reason)
    by = _by_ratio if a.logarithmic and b.logarithmic else _by_difference
    return by(blank, a, b, logs)


def _is_open(value: ValueEstimate) -> bool:
    """Whether the log says nothing of a value, or what speaks against it is not its width."""
    # One whose interval is merely wide is compared: the interval of the difference is as wide.
    half = value.half_width
    known = isfinite(half) and isfinite(value.value) and 0.0 < value.std < inf
    if not (known and value.degrees_of_freedom > 0.0):
        return True
    wide = half > THRESHOLDS.weak_width * abs(value.value)
    return value.verdict == "undetermined" and not wide


def _by_difference(
    blank: Difference, a: ValueEstimate, b: ValueEstimate, logs: Sharing
) -> Difference:
    """With an interval that is symmetrical about the difference."""
    value = difference(blank.name, a.value, b.value)
    reach, chance = _spread(value, a.std, b.std, a, b, logs)
    apart_from_zero = a.value != 0.0 and a.interval[0] * a.interval[1] > 0.0
    percent = 100.0 / abs(a.value) if apart_from_zero and blank.name not in ANGLES else nan
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
    return replace(
        blank,
        value=b.value - a.value,
        interval=(a.value * low, a.value * high),
        percent=100.0 * (b.value / a.value - 1.0),
        percent_interval=(100.0 * low, 100.0 * high),
        probability=chance,
        outcome="no change",
    )


# The difference of estimates from different logs has the variance s² = s_a² + s_b², with
# 1/ν = (s_a²/s²)²/ν_a + (s_b²/s²)²/ν_b (Welch and Satterthwaite). Those of one log share errors of
# which nothing is stored: their deviation is s_a + s_b at most.
def _spread(
    value: float, std_a: float, std_b: float, a: ValueEstimate, b: ValueEstimate, logs: Sharing
) -> tuple[float, float]:
    """Half the width of a difference's interval, and the chance of one as large as the value."""
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
    """Outcomes that hold for all together (Holm)."""
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
    """Which of several differences are significant, if any may be so by chance only this rarely."""
    found = [False] * len(probabilities)
    for rank, place in enumerate(np.argsort(probabilities)):
        if not probabilities[place] <= chance / (len(probabilities) - rank):
            break
        found[place] = True
    return found


def shared_logs(a: Mapping[str, Any], b: Mapping[str, Any]) -> Sharing:
    """Whether the provenances of two estimates name the same axes of the same files."""
    first, second = _named_logs(a), _named_logs(b)
    in_both = [any(_one_axis(log, other) for other in second) for log in first]
    in_both += [any(_one_axis(log, other) for other in first) for log in second]
    if not any(in_both):
        return "different"
    return "same" if all(in_both) else "some shared"


def _named_logs(provenance: Mapping[str, Any]) -> list[tuple[str, set[str]]]:
    """Digests of the files, each with the columns of its positions: it may hold several axes."""
    found = []
    for source in provenance.get("inputs", ()):
        origins = source.get("columns", {})
        read = (origins.get(c) for c in ("motor_position", "link_position", "deflection"))
        if source.get("sha256"):
            columns = {column for origin in read if origin for column in origin["columns"]}
            found.append((source["sha256"], columns))
    return found


def _one_axis(log: tuple[str, set[str]], other: tuple[str, set[str]]) -> bool:
    """Whether both hold one axis' noise; where columns are not named, one file is one axis."""
    apart = log[1] and other[1] and not log[1] & other[1]
    return log[0] == other[0] and not apart


_JOINTS = {
    "flexible": "a flexible joint",
    "link": "a link alone",
    "rigid": "a rigid joint",
    "arm": "an arm",
}


def _doubts(a: Either, b: Either, logs: Sharing) -> Iterator[str]:
    """What limits a comparison, a sentence each."""
    sides = {"A": a, "B": b}
    if a.model != b.model:
        yield (
            f"A is of {_JOINTS[a.model]} and B of {_JOINTS[b.model]}: only what has the same "
            f"name, meaning and unit in both is compared"
        )
    if logs == "some shared":
        yield (
            "some logs are in both estimates, which therefore err alike: the intervals allow for "
            "the worst of that, and a change may be missed"
        )
    unnamed = [side for side, e in sides.items() if not _named_logs(e.provenance)]
    if unnamed:
        yield (
            f"{' and '.join(unnamed)} does not say which logs it was made from: they are taken for "
            f"different ones"
        )
    known = [e.provenance.get("settings", {}).get("known", {}) for e in sides.values()]
    common = [name for name in known[0] if name in known[1]]
    if common:
        yield (
            f"both rest on what was said of {' and '.join(common)}: if that has changed, other "
            f"values seem to have changed in its stead"
        )
    unexplained = [
        side
        for side, e in sides.items()
        if (e.disturbances is not None if e.model == "arm" else e.unexplained)
    ]
    if unexplained and logs != "same":
        yield (
            f"in {' and '.join(unexplained)} the residuals hold something that no term describes. "
            f"It may look like a change where the motions differ: compare logs of the same motion"
        )
    for side, estimate in sides.items():
        yield from (f"{side}: {warning}" for warning in estimate.warnings)


_ALIKE = 2.0  # ratio of two widths beyond which what rests on them is not compared

_OWN_RATIO = {RIPPLE_NUMBER: 1.02, RIPPLE_ORIGIN: 1.0 + 1e-9}
"""That of constants beyond which ripples, or the turns that their angles count, are others."""


@cache
def _constants() -> Sequence[tuple[str, str]]:
    """Coefficients that have a width, and the constant that it is."""
    regressors = [r for t in SHAPE_TERMS.values() for r in (*t.link.items(), *t.motor.items())]
    # Where encoders have their zeros, and so the middle of a play, is a matter of each log.
    return [(c, shape) for c, r in regressors for shape in WIDTHS if shape in r]


def _unlike_constants(a: Identification, b: Identification) -> dict[tuple[str, str], str]:
    """Why what rests on a coefficient cannot be compared, by coefficient and constant."""
    found = {}
    for coefficient, shape in _constants():
        first, second = (estimate.choices.shapes.get(shape) for estimate in (a, b))
        if first is None or second is None or not _apart(first, second, shape):
            continue
        if not (_is_gap(shape, a) and _is_gap(shape, b)):
            found[coefficient, shape] = (
                f"it rests on a {shape} of {first:.5g} in A and of {second:.5g} in B, which was "
                f"chosen for each log"
            )
    return found


def _apart(first: float, second: float, shape: str) -> bool:
    least, most = sorted((abs(first), abs(second)))
    return most > _OWN_RATIO.get(shape, _ALIKE) * least or first * second < 0.0


def _is_gap(shape: str, estimate: Identification) -> bool:
    """Whether a width is that of the estimate's own gap, not one that was chosen."""
    gap = estimate.parameters.get("half_backlash")
    if shape != BACKLASH_WIDTH or gap is None:
        return False
    return not _apart(gap.value, estimate.choices.shapes[shape], shape)


def _unlike_reason(
    name: str, rests_on: Mapping[str, float], unlike: Mapping[tuple[str, str], str]
) -> str:
    """Why the values of a number cannot be compared; empty where no constant speaks against it."""
    for (coefficient, shape), reason in unlike.items():
        # However a ripple counts, it is as large.
        if coefficient in rests_on and (name, shape) != ("torque_ripple", RIPPLE_ORIGIN):
            return reason
    return ""
