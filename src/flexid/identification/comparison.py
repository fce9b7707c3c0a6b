"""Two estimates side by side: what differs, and whether chance explains it.

Of each number that both hold, the difference d = b - a has the variance s² = s_a² + s_b² where the
logs are different ones, with

    1/ν = (s_a²/s²)²/ν_a + (s_b²/s²)²/ν_b

degrees of freedom (Welch and Satterthwaite). Where both intervals are symmetrical on the logarithm,
so is that of the difference. Estimates of one and the same log have errors in common, of which
nothing is stored; whatever these are, the deviation of d is s_a + s_b at most, and that is taken.

Each difference has its own interval at 95 %. What is *changed* has to be so beside all others that
are compared (Holm): where nothing has changed, one comparison in twenty names anything at all.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, inf, isfinite, log, nan
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.special import stdtr

import flexid
from flexid.errors import SettingError
from flexid.identification.angles import ANGLES, difference
from flexid.identification.estimate_origins import Sharing, apart, doubts, shared_logs
from flexid.identification.intervals import CONFIDENCE, quantile
from flexid.identification.joint_difference import JointTest, joint_test, welch
from flexid.identification.judgement import THRESHOLDS
from flexid.identification.result import Identification, ValueEstimate
from flexid.identification.shape_widths import reason_of, unlike_width

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

Values = Mapping[str, ValueEstimate]

_NOTHING = "nothing is known of it"
_COMPARED = frozenset({"changed", "perhaps changed", "no change", "contradictory", "compatible"})


@dataclass(frozen=True)
class Difference:
    """One number of both estimates.

    Parameters
    ----------
    name, unit : str
        Name and SI unit.
    a, b : ValueEstimate or None
        The number in each estimate; None where it has none.
    without : tuple of str
        "A" or "B" where the model does without it, and how large it could be is compared.
    value : float
        B's minus A's, in the unit; NaN where they are not compared.
    interval : tuple of float
        Lower and upper end of the 95 % interval of the difference.
    percent, percent_interval : float, tuple of float
        The same in per cent of A's value; NaN where A's may be zero, or is an angle.
    probability : float
        Of a difference as large by chance; NaN where they are not compared.
    outcome : Outcome
        What the difference deserves.
    reason : str
        Why it is not compared; else empty.
    """

    name: str
    unit: str
    a: ValueEstimate | None
    b: ValueEstimate | None
    without: tuple[str, ...] = ()
    value: float = nan
    interval: tuple[float, float] = (nan, nan)
    percent: float = nan
    percent_interval: tuple[float, float] = (nan, nan)
    probability: float = nan
    outcome: Outcome = "not compared"
    reason: str = ""

    @property
    def compared(self) -> bool:
        """Whether there is a difference with an interval."""
        return self.outcome in _COMPARED

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
    """Two estimates side by side.

    Parameters
    ----------
    labels : tuple of str
        What A and B are called: their files, if they have any.
    models : tuple of str
        Which joint was identified in each.
    parameters, coefficients : mapping of str to Difference
        By name, in the order of A, then what B has beside that.
    together : JointTest or None
        All coefficients of both at once; None where that cannot be tested.
    logs : {"different", "some shared", "same"}
        Whether both were made from the same logs.
    settings : mapping of str to tuple of str
        What was asked for, chosen or used otherwise: A's and B's, by name.
    warnings : tuple of str
        What limits the comparison.
    provenance : mapping
        Version, and that of both estimates.
    """

    labels: tuple[str, str]
    models: tuple[str, str]
    parameters: Mapping[str, Difference]
    coefficients: Mapping[str, Difference]
    together: JointTest | None
    logs: Sharing
    settings: Mapping[str, tuple[str, str]]
    warnings: tuple[str, ...] = ()
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
        """Whether a change is established, or a contradiction: of one number or of all together."""
        together = self.together is not None and self.together.significant
        return together or bool(self.having("changed", "contradictory"))

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


def compare_estimates(
    a: Identification, b: Identification, labels: tuple[str, str] = ("A", "B")
) -> Comparison:
    """Compare two estimates number by number, and as a whole.

    Parameters
    ----------
    a, b : Identification
        Before and after, or of one drive and another.
    labels : tuple of str, optional
        What they are called.

    Returns
    -------
    Comparison

    Raises
    ------
    SettingError
        If both are the same estimate.
    """
    if _same(a, b):
        raise SettingError(
            "compare",
            f"{labels[0]} and {labels[1]} hold the same estimate: give two that differ in their "
            f"logs or settings",
        )
    logs = shared_logs(a.provenance, b.provenance)
    unlike = unlike_width(a, b)
    whole = ({**a.removed, **a.parameters}, {**b.removed, **b.parameters})
    parameters = _differences(whole, (a.parameters, b.parameters), logs, unlike)
    coefficients: dict[str, Difference] = {}
    if a.model == b.model or "rigid" not in (a.model, b.model):  # names mean the same in both
        both = (a.coefficients, b.coefficients)
        coefficients = _differences(both, both, logs, unlike)
    sound = [name for name, d in coefficients.items() if d.compared]
    together = joint_test(a, b, sound) if logs == "different" else None
    chances = [] if together is None else [together.probability]
    decided = any(d.outcome in _COMPARED for d in parameters.values())
    parameters, first = _judged(parameters, chances if decided else [], logs)
    coefficients, second = _judged(coefficients, [] if decided else chances, logs)
    if together is not None:
        together = replace(together, significant=(*first, *second)[0])
    return Comparison(
        labels,
        (a.model, b.model),
        parameters,
        coefficients,
        together,
        logs,
        apart(a, b),
        doubts(a, b, logs),
        {"flexid_version": flexid.__version__, "a": dict(a.provenance), "b": dict(b.provenance)},
    )


def _same(a: Identification, b: Identification) -> bool:
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
    unlike: Mapping[str, str],
) -> dict[str, Difference]:
    """Differences of all that either model has, by name.

    Parameters
    ----------
    known : tuple of mapping of str to ValueEstimate
        What each estimate says anything of.
    reported : tuple of mapping of str to ValueEstimate
        What each model has.
    logs : Sharing
        Whether both were made from the same logs.
    unlike : mapping of str to str
        Coefficients whose shapes are of unlike widths, and why that forbids to compare them.
    """
    names = dict.fromkeys([*reported[0], *reported[1]])
    found = {}
    for name in names:
        a, b = (values.get(name) for values in known)
        pairs = zip("AB", reported, strict=True)
        without = tuple(side for side, values in pairs if name not in values)
        unit = next(value.unit for value in (a, b) if value is not None)
        blank = Difference(name, unit, a, b, without)
        found[name] = _filled(blank, logs, reason_of(unlike, a, b))
    return found


def _filled(blank: Difference, logs: Sharing, unlike: str) -> Difference:
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
            return replace(blank, reason=f"in {side} it was not estimated: {_why_fixed(value)}")
    for side, value in (("A", a), ("B", b)):
        if _open(value):
            return replace(
                blank, outcome="not determined", reason=f"in {side} {value.reason or _NOTHING}"
            )
    if a.logarithmic and b.logarithmic:
        return _by_ratio(blank, a, b, logs)
    return _by_difference(blank, a, b, logs)


def _why_fixed(value: ValueEstimate) -> str:
    return "it follows from what was given" if value.reason in ("", "given") else value.reason


def _open(value: ValueEstimate) -> bool:
    """Whether the log says nothing of a value, or something else than its width speaks against it.

    A value whose interval is merely wide is compared: the interval of the difference is as wide.
    """
    half = 0.5 * (value.interval[1] - value.interval[0])
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
    spread = _spread(a.std, b.std, a, b, logs)
    reach = spread.reach
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
        probability=spread.probability(value),
        outcome="no change",
    )


def _by_ratio(blank: Difference, a: ValueEstimate, b: ValueEstimate, logs: Sharing) -> Difference:
    """With an interval that is symmetrical about the logarithm of the ratio."""
    logarithm = log(b.value) - log(a.value)
    spread = _spread(a.std / a.value, b.std / b.value, a, b, logs)
    with np.errstate(over="ignore"):
        low, high = np.expm1([logarithm - spread.reach, logarithm + spread.reach]).tolist()
    change = b.value / a.value - 1.0
    return replace(
        blank,
        value=b.value - a.value,
        interval=(a.value * low, a.value * high),
        percent=100.0 * change,
        percent_interval=(100.0 * low, 100.0 * high),
        probability=spread.probability(logarithm),
        outcome="no change",
    )


class _Spread(NamedTuple):
    """Standard deviation of a difference, and its degrees of freedom."""

    std: float
    degrees_of_freedom: float

    @property
    def reach(self) -> float:
        """Half the width of the interval."""
        return quantile(self.degrees_of_freedom) * self.std

    def probability(self, value: float) -> float:
        """Of a difference as large by chance."""
        return float(2.0 * stdtr(self.degrees_of_freedom, -abs(value) / self.std))


def _spread(
    std_a: float, std_b: float, a: ValueEstimate, b: ValueEstimate, logs: Sharing
) -> _Spread:
    freedom = (a.degrees_of_freedom, b.degrees_of_freedom)
    if logs != "different":
        return _Spread(std_a + std_b, min(freedom))
    return _Spread(hypot(std_a, std_b), welch((std_a, std_b), freedom))


def _judged(
    differences: Mapping[str, Difference], beside: Sequence[float], logs: Sharing
) -> tuple[dict[str, Difference], list[bool]]:
    """Outcomes that hold for all together, and the same for probabilities beside them (Holm)."""
    compared = [d for d in differences.values() if d.outcome in _COMPARED]
    chances = [*(d.probability for d in compared), *beside]
    significant = holm(chances, 1.0 - CONFIDENCE)
    judged = dict(differences)
    for d, certain in zip(compared, significant, strict=False):
        outcome: Outcome = "compatible" if logs == "same" else "no change"
        if certain:
            outcome = "contradictory" if logs == "same" else "changed"
        elif logs != "same" and d.probability < 1.0 - CONFIDENCE:
            outcome = "perhaps changed"
        judged[d.name] = replace(d, outcome=outcome)
    return judged, significant[len(compared) :]


def holm(probabilities: Sequence[float], chance: float) -> list[bool]:
    """Which of several differences are significant, if any may be so by chance only this rarely.

    Parameters
    ----------
    probabilities : sequence of float
        Of each difference by chance.
    chance : float
        That any of them is called significant where there is none.

    Examples
    --------
    >>> holm([0.04, 0.001, 0.03], 0.05)
    [False, True, False]
    """
    found = [False] * len(probabilities)
    for rank, place in enumerate(np.argsort(probabilities)):
        if not probabilities[place] <= chance / (len(probabilities) - rank):
            break
        found[place] = True
    return found
