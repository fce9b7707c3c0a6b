"""Intervals and verdicts of coefficients and parameters, and whether a log shows a compliance.

The verdict on a number follows from the width of its interval. Doubts about the structure, model
error, correlated residuals and delays all widen the interval.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.unknowns import FIXED, Unknowns
from flexid.identification.preparation.joint import Joint
from flexid.identification.preparation.recordings import SplitRecordings
from flexid.identification.vocabulary.evidence import (
    Compliance,
    Estimate,
    Validation,
    ValueEstimate,
    Verdict,
    balance_of,
    interval,
    logarithmic_interval,
)
from flexid.identification.vocabulary.thresholds import THRESHOLDS, Thresholds
from flexid.models.flexible_joint import CONSTANT_UNITS, POSITIVE
from flexid.models.motion import unit_of
from flexid.models.physical import PhysicalParameter, Product, Sum, ZeroAngle
from flexid.recording.velocities import position_noise

Judged = tuple[Verdict, str]


def verdict(
    value: float,
    interval: tuple[float, float],
    effect: float = float("inf"),
    thresholds: Thresholds = THRESHOLDS,
) -> Judged:
    """Judge a number by its interval; the reason is empty if the number is determined."""
    half = 0.5 * (interval[1] - interval[0])
    if half == 0.0:
        return "determined", ""
    if not isfinite(half):
        return "undetermined", "the log has no information on it"
    relative = half / abs(value) if value else float("inf")
    if relative <= thresholds.determined_width or effect <= thresholds.negligible_share:
        return "determined", ""
    reason = f"its interval reaches {_percent(relative)} to either side"
    return ("weak" if relative <= thresholds.weak_width else "undetermined"), reason


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share < 10.0 else "far"


def _angle_verdict(interval: tuple[float, float], thresholds: Thresholds) -> Judged:
    """Judge an angle by its interval over 1 rad, since its value depends on the origin.

    An error of 0.2 rad leaves a fifth of a sine.
    """
    judged, reason = verdict(1.0, interval, thresholds=thresholds)
    half = 0.5 * (interval[1] - interval[0])
    if reason and isfinite(half):
        reason = f"its interval reaches {half:.2g} rad to either side"
    return judged, reason


def widest(estimates: Mapping[str, ValueEstimate], sizes: Mapping[str, float]) -> float:
    """Return the largest half-width over its value, or over its row's acceleration if less."""

    def relative(found: ValueEstimate) -> float:
        half = found.half_width
        if half == 0.0:
            return 0.0  # given
        own = 1.0 / abs(found.value) if found.value else np.inf
        return half * min(own, sizes.get(found.name, np.inf))

    return max(map(relative, estimates.values()), default=0.0)


def judged_value(
    name: str,
    unit: str,
    value: float,
    std: float,
    freedom: float,
    size: float = np.inf,
    thresholds: Thresholds = THRESHOLDS,
) -> ValueEstimate:
    """Return a fitted number with interval and verdict; `size` is the effect of one unit."""
    ends = interval(value, std, freedom)
    effect = 0.5 * (ends[1] - ends[0]) * size
    judged = verdict(value, ends, effect, thresholds)
    return ValueEstimate(name, unit, value, std, ends, *judged, freedom, slopes={name: 1.0})


def judged_function(
    function: PhysicalParameter,
    values: Mapping[str, float],
    estimate: Estimate,
    thresholds: Thresholds = THRESHOLDS,
) -> ValueEstimate:
    """Return a function of fitted values with interval (delta method) and verdict.

    The value is nan if the function divides by a coefficient that is zero.
    """
    value = function.value(values)
    value = value if np.isfinite(value) else np.nan
    names = tuple(name for name in estimate.names if name in function.coefficients)
    ends, std, freedom, logarithmic, slopes = (value, value), 0.0, np.inf, False, {}
    if names:  # otherwise all its coefficients were given
        places = [estimate.names.index(name) for name in names]
        gradient = function.gradient(values, names)
        freedom = float(min(estimate.degrees_of_freedom[i] for i in places))
        std = _deviation(gradient, estimate.covariance[np.ix_(places, places)])
        positive = set(names) <= POSITIVE and value > 0.0
        logarithmic = positive and _degree(gradient, names, values) < 0
        ends = (logarithmic_interval if logarithmic else interval)(value, std, freedom)
        slopes = dict(zip(names, gradient.tolist(), strict=True))
    judged = verdict(value, ends, thresholds=thresholds)
    if isinstance(function, ZeroAngle):
        judged = _angle_verdict(ends, thresholds)
    name, unit = function.name, function.unit
    return ValueEstimate(name, unit, value, std, ends, *judged, freedom, logarithmic, slopes)


_ROUNDING = 1e-6  # of the largest share; a smaller degree counts as zero


def _deviation(gradient: FloatArray, covariance: FloatArray) -> float:
    if not (np.isfinite(covariance).all() and np.isfinite(gradient).all()):
        return np.inf
    return float(np.sqrt(gradient @ covariance @ gradient))


def _degree(gradient: FloatArray, names: tuple[str, ...], values: Mapping[str, float]) -> int:
    """Return the sign of the degree of homogeneity, from Euler's g'p = degree g, with g > 0."""
    shares = gradient * [values[name] for name in names]
    degree = float(np.sum(shares))
    if not abs(degree) >= _ROUNDING * float(np.abs(shares).max()):  # also for a coefficient of 0
        return 0
    return int(np.sign(degree))


@dataclass(frozen=True, eq=False)
class Judge:
    """Judge of the coefficients and the physical parameters of a joint."""

    joint: Joint
    unknowns: Unknowns
    input_unit: str
    thresholds: Thresholds = THRESHOLDS
    link_is_clamped: bool = False

    def judged(
        self,
        estimate: Estimate,
        fixed: Mapping[str, tuple[float, str]],  # known coefficients, each with the reason
        sizes: Mapping[str, float] | None = None,  # effect of one unit of each coefficient
        exact: Mapping[str, tuple[float, str]] | None = None,  # the same for parameters
    ) -> tuple[dict[str, ValueEstimate], dict[str, ValueEstimate]]:
        """Return all coefficients and parameters; known ones have an interval of zero width."""
        coefficients = self._coefficients(estimate, fixed, sizes or {})
        parameters = self._parameters(estimate, coefficients, exact or {})
        if self.link_is_clamped:  # as if its inertia was infinite
            hidden = {name: c for name, c in coefficients.items() if balance_of(name) == "link"}
            coefficients |= {n: _exactly(n, c.unit, 0.0, "given") for n, c in hidden.items()}
            seen = parameters.items()
            parameters = {name: p for name, p in seen if hidden.keys().isdisjoint(p.slopes)}
        return coefficients, parameters

    def _coefficients(
        self,
        estimate: Estimate,
        fixed: Mapping[str, tuple[float, str]],
        sizes: Mapping[str, float],
    ) -> dict[str, ValueEstimate]:
        joint, estimates = self.joint, {}
        for name in estimate.names:
            if _base(name) not in joint.units:  # a delay
                continue
            # Only a coefficient of an optional term can be determined to be negligible.
            size = sizes.get(name, np.inf) if _base(name) in joint.optional else np.inf
            seen = *estimate.of(name), size, self.thresholds
            estimates[name] = judged_value(name, self._unit_of(name), *seen)
        for name, known in fixed.items():
            estimates[name] = _exactly(name, self._unit_of(name), *known)
        estimates |= self._tied(estimate, estimates)
        doubts = _doubts(estimates)
        estimates |= {
            name: e.unknown(doubts[balance_of(name)])
            for name, e in estimates.items()
            if e.slopes and balance_of(name) in doubts
        }
        order = list(joint.units)
        return dict(sorted(estimates.items(), key=lambda item: order.index(_base(item[0]))))

    def _unit_of(self, coefficient: str) -> str:
        return self.joint.unit_of(self.joint.units[_base(coefficient)], self.input_unit)

    def _tied(
        self, estimate: Estimate, known: Mapping[str, ValueEstimate]
    ) -> dict[str, ValueEstimate]:
        """Return the coefficients that follow from others, by the delta method."""
        values = {name: found.value for name, found in known.items()}
        found = {}
        for name, (a, b, d) in self.unknowns.tied.items():
            if a not in known or b not in known or d not in known:
                continue
            tie = Product(name, self._unit_of(name), {**Counter((a, b)), d: -1})
            tied = judged_function(tie, values, estimate, self.thresholds)
            if np.isfinite(tied.std) and known[a].verdict == "determined":  # perhaps as negligible
                tied = replace(tied, verdict="determined", reason="")
            found[name] = tied
        return found

    def _parameters(
        self,
        estimate: Estimate,
        coefficients: Mapping[str, ValueEstimate],
        exact: Mapping[str, tuple[float, str]],
    ) -> dict[str, ValueEstimate]:
        """Return the physical parameters that the coefficients determine, by the delta method.

        A parameter with a coefficient that differs by log is given for each log. A sum is given if
        it is known and one of its parts is not determined.
        """
        estimates: dict[str, ValueEstimate] = {}
        doubts = _doubts(coefficients)
        for recording in _one_recording_of_each_group(self.unknowns):
            labels = _labels(self.unknowns, recording, coefficients)
            values = {c: coefficients[label].value for c, label in labels.items()}
            renamed = _renamed(estimate, labels)
            for parameter in self.joint.parameters(labels, self.input_unit):
                if parameter.name in exact:
                    known = exact[parameter.name]
                    estimates[parameter.name] = _exactly(parameter.name, parameter.unit, *known)
                    continue
                own = [labels[c] for c in parameter.coefficients]
                of_group = next((label[label.index("[") :] for label in own if "[" in label), "")
                found = judged_function(parameter, values, renamed, self.thresholds)
                judged = self._judged_by(parameter, found, [coefficients[label] for label in own])
                if isinstance(parameter, Sum) and (
                    judged[0] == "undetermined"
                    or all(estimates[part.name].verdict == "determined" for part in parameter.parts)
                ):
                    continue
                name, (judgement, reason) = parameter.name + of_group, judged
                slopes = {labels[c]: slope for c, slope in found.slopes.items()}
                estimates[name] = replace(
                    found, name=name, verdict=judgement, reason=reason, slopes=slopes
                )
                for doubt in filter(None, (doubts.get(balance_of(label)) for label in slopes)):
                    estimates[name] = estimates[name].unknown(doubt)
        return estimates

    def _judged_by(
        self, parameter: PhysicalParameter, found: ValueEstimate, made_of: Sequence[ValueEstimate]
    ) -> Judged:
        """Return the verdict on a parameter, by its interval and by those of its coefficients."""
        verdicts = {coefficient.verdict for coefficient in made_of}
        by_width = (verdict(c.value, c.interval, thresholds=self.thresholds)[0] for c in made_of)
        if (
            found.verdict != "determined"
            and np.isfinite(found.interval).all()
            and verdicts == {"determined"}
            and {*by_width} != verdicts
        ):
            return "determined", ""  # its term is determined as negligible
        if not found.slopes:
            return found.verdict, min(c.reason for c in made_of)  # at its bound, or given
        if isinstance(parameter, ZeroAngle) and verdicts == {"undetermined"}:
            # Gravity may be zero here, and then the delta method fails for its angle.
            return "undetermined", made_of[0].reason
        return found.verdict, found.reason


def _exactly(name: str, unit: str, value: float, reason: str) -> ValueEstimate:
    """Return a known number, whose interval has no width."""
    return ValueEstimate(name, unit, value, 0.0, (value, value), "determined", reason)


def _doubts(estimates: Mapping[str, ValueEstimate]) -> dict[str, str]:
    """Return, by balance, the reason why its values are unknown: a negative spring or inertia."""
    # With a negative stiffness in one balance, the values of the other balance are still used.
    doubts: dict[str, str] = {}
    for name in sorted(POSITIVE & estimates.keys()):
        if estimates[name].value <= 0.0 and np.isfinite(estimates[name].std):
            reason = f"{name} came out negative, which no spring or inertia can be"
            doubts.setdefault(balance_of(name), reason)
    return doubts


_OF_ITS_TERM = "its term is undetermined"


def constant_estimates(
    joint: Joint,
    constants: Mapping[str, tuple[float, float, float]],
    parameters: Mapping[str, ValueEstimate],
    thresholds: Thresholds = THRESHOLDS,
) -> dict[str, ValueEstimate]:
    """Return constants of shapes; each is given as value, std and degrees of freedom.

    A constant is unknown if all parameters of its term are, or may be zero.
    """
    estimates = {}
    for name, (value, std, freedom) in constants.items():
        unit = joint.unit_of(CONSTANT_UNITS[name], "")
        known = name, unit, value, std, freedom, np.inf, thresholds
        found = judged_value(*known)
        # A constant with infinite deviation was held fixed, not fitted.
        found = found if np.isfinite(std) else replace(found, slopes={})
        of_term = [
            parameter
            for parameter in parameters.values()
            if any(joint.nonlinear.get(_base(own)) == name for own in parameter.slopes)
        ]
        hidden = of_term and not any(map(_is_seen, of_term))
        estimates[name] = found.unknown(_OF_ITS_TERM) if hidden else found
    return estimates


def _is_seen(found: ValueEstimate) -> bool:
    """Whether a value is known and not zero."""
    low, high = found.interval
    return found.verdict != "undetermined" and not low <= 0.0 <= high


def without_unused_link(estimate: Estimate, values: Iterable[ValueEstimate]) -> Estimate:
    """Return the estimate without coefficients of the link on which no value depends."""
    used = {name for value in values for name in value.slopes}
    return estimate.without({n for n in estimate.names if balance_of(n) == "link"} - used)


def _renamed(estimate: Estimate, labels: Mapping[str, str]) -> Estimate:
    """Return the estimate with the names that the coefficients have in one recording."""
    base = {label: c for c, label in labels.items()}
    return replace(estimate, names=tuple(base.get(name, name) for name in estimate.names))


def _one_recording_of_each_group(unknowns: Unknowns) -> list[int]:
    groups = unknowns.groups or (0,)
    return [groups.index(group) for group in sorted(set(groups))]


def _labels(
    unknowns: Unknowns, recording: int, coefficients: Mapping[str, ValueEstimate]
) -> dict[str, str]:
    """Return the name in `coefficients` of each of the system's coefficients that is on."""
    columns = unknowns.columns(recording)
    group = unknowns.groups[recording] + 1 if unknowns.groups else 1
    labels = {}
    for c, column in zip(unknowns.system.coefficients, columns, strict=True):
        if c in unknowns.tied:
            continue
        own = unknowns.names[column] if column != FIXED else f"{c}[{group}]"
        label = own if own in coefficients else c
        if label in coefficients:
            labels[c] = label
    return labels


def _base(name: str) -> str:
    return name.partition("[")[0]


WEAK_FIT = 50.0
"""Least part of the deflection, in per cent, that a real spring explains in a free run."""

_BEYOND_NOISE = 3.0  # least ratio of a visible deflection to its noise


def of_joint(recordings: SplitRecordings, found: Validation) -> Compliance:
    """Judge whether the spring explains the held-out deflection, if that is more than noise."""
    ends = [p.deflection[s:] for p, s in zip(recordings.recorded, recordings.starts, strict=True)]
    moved, ever = _spread(ends), _spread([p.deflection for p in recordings.recorded])
    noise = max(
        float(np.hypot(position_noise(p.needed_link_position), position_noise(p.motor_position)))
        for p in recordings.recorded
    )
    unit = unit_of("rad", recordings.recorded[0].joint)
    fit = found.fit_percent["deflection"]
    is_still = moved < _BEYOND_NOISE * noise or np.isnan(fit)
    if is_still and max(moved, noise) < ever / _BEYOND_NOISE:  # it has died out
        reason = f"the deflection moves by {ever:.2g} {unit}, but only before the held-out part"
        return Compliance(True, reason, ever, noise)
    visible, reason = _judge(fit, moved, noise, unit)
    return Compliance(visible, reason, moved, noise)


def _spread(parts: Sequence[FloatArray]) -> float:
    """Return the standard deviation of a signal, each part of it about its own mean."""
    squares = sum(float(np.sum((part - part.mean()) ** 2)) for part in parts)
    return float(np.sqrt(squares / sum(map(len, parts))))


def of_link_alone(
    recordings: SplitRecordings, driven: Validation, stiffness: ValueEstimate
) -> Compliance:
    """Judge whether the spring explains the deflection that the motor's motion causes."""
    found = of_joint(recordings, driven)
    if found.visible and stiffness.verdict == "undetermined":
        unit = unit_of("rad", recordings.recorded[0].joint)
        reason = (
            f"the deflection moves by {found.deflection:.2g} {unit}, but another stiffness would "
            f"explain it as well"
        )
        return replace(found, visible=False, reason=reason)
    return found


def _judge(fit: float, deflection: float, noise: float, unit: str) -> tuple[bool, str]:
    size = f"the deflection moves by {deflection:.2g} {unit}"
    # A coarsely sampled motion looks like noise, but no spring explains noise in a free run.
    explained = fit >= 100 * (1 - 1 / _BEYOND_NOISE)
    if deflection < _BEYOND_NOISE * noise and not explained:
        return False, f"{size}, hardly more than its noise of {noise:.2g} {unit}"
    if np.isnan(fit):
        return False, f"{size} in the held-out part, too little to be tested"
    if fit < WEAK_FIT:
        return False, f"{size}, but the spring explains only {max(fit, 0.0):.0f} % of it"
    return True, f"{size}, of which the spring explains {fit:.0f} % in a free run"
