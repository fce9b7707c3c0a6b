"""What the user states of a drive: before anything is fitted, and joined to what a fit says.

A physical parameter is a function of coefficients. Where all of these but one are known exactly,
what is stated of the parameter is stated of that one: a known value fixes it, bounds become its
bounds, and the fit heeds them. What is stated of a function of several unknown coefficients is
joined to the fit afterwards.

A coefficient or physical parameter g(p) known as v with standard deviation s is one more
measurement. With p̂ and C the fit's values and covariance, and h the gradient of g,

    K = C h / (hᵀC h + s²),    p = p̂ + K (v - g(p̂)),    C - K hᵀC

are the values and covariance of both together, exactly so if g is linear and the noise normal;
where g is not linear, the step is repeated from where it led until it stays there. The covariance
of the fit is taken as it is, right for correlated residuals, so that the log gets the weight that
it deserves. s = 0 fixes g(p) at v; a large s changes nothing.

Where the log leaves a coefficient entirely free there is no C to start from, and what is known of
it has to be given as exact.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isclose, isfinite

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import ConvergenceError, SettingError, did_you_mean
from flexid.estimators.normal_equations import pseudo_inverse
from flexid.identification.preparation.joint import Joint
from flexid.identification.preparation.settings import Settings
from flexid.identification.vocabulary.evidence import Estimate
from flexid.identification.vocabulary.thresholds import THRESHOLDS
from flexid.models.flexible_joint import POSITIVE
from flexid.models.motion import FORCES
from flexid.models.physical import Amplitude, PhysicalParameter, Product

_STEPS = 100
_CONVERGED = 1e-10  # relative change of the values by a step
_NULL = 1e-15  # of the largest eigenvalue
_LEAST_FREEDOM = 0.5
_LARGEST_STEP = 0.5  # of a positive coefficient's value, lest it jump across zero


@dataclass(frozen=True)
class Known:
    """A coefficient or physical parameter that is known beforehand."""

    name: str  # of the coefficient or physical parameter
    value: float
    std: float  # what it is known as, and the standard deviation of that; 0 if it is known exactly
    bound: bool = False  # whether it is the end of a range that the log leaves

    def __post_init__(self) -> None:
        if not (np.isfinite(self.value) and np.isfinite(self.std) and self.std >= 0.0):
            raise SettingError(
                "known",
                f"{self.name} = {self.value:g} ± {self.std:g} is no value with an uncertainty: "
                f"give two finite numbers, the second not negative",
            )


def informed(
    fit: Estimate,
    known: Sequence[Known],
    parameters: Sequence[PhysicalParameter] = (),
    given: Mapping[str, float] | None = None,
    contradiction: float = THRESHOLDS.contradiction,
) -> tuple[Estimate, dict[str, str]]:
    """Join knowledge to a fit.

    Returns of both. What was known counts as known exactly in its uncertainty, so the more a
    value rests on it, the more degrees of freedom (Welch and Satterthwaite). contradicted :
    dict of str to str By name, a sentence on what is known otherwise than the log says.
    """
    wanted = [_parameter(item.name, fit, parameters) for item in known]
    finite = np.isfinite(np.diag(fit.covariance))
    alone = _Linearised(fit.names, np.asarray(fit.values, dtype=np.float64), given or {}, wanted)
    variances = np.array([item.std for item in known]) ** 2
    covariance = np.where(np.outer(finite, finite), fit.covariance, 0.0)
    values = np.array([item.value for item in known])
    both, gain = _joined(alone, covariance, values, variances)
    involved = np.any(both.slopes != 0.0, axis=0)
    fewest = min(fit.degrees_of_freedom[i] for i in np.flatnonzero(involved))
    kept = np.eye(len(fit.names)) - gain @ both.slopes
    # A gain from an estimated covariance costs a degree of freedom, as a regression does, in the
    # variance that is left and in the gain's own error: as far as knowledge prevails over the log.
    left = max(fewest - float(np.trace(both.slopes @ gain)), _LEAST_FREEDOM)
    cost = 1.0 if np.isinf(fewest) else (fewest / left) ** 2
    from_log = cost * kept @ covariance @ kept.T
    total = from_log + (gain * variances) @ gain.T
    freedom = _welch_satterthwaite(
        np.minimum(fit.degrees_of_freedom, left), np.diag(from_log), np.diag(total)
    )
    freedom[~finite] = 0.0
    total[~finite, ~finite] = np.inf
    estimate = Estimate(fit.names, both.point, total, tuple(freedom.tolist()))
    contradicted = _contradictions(alone, covariance, known, contradiction)
    if contradicted:  # what is known as certain, and what the log says
        certain, _ = _joined(alone, covariance, values, np.zeros_like(variances))
        to_log, to_known = both.point - alone.point, certain.point - both.point
        farther = max((to_log, to_known), key=lambda c: float(np.linalg.norm(both.slopes @ c)))
        estimate = estimate.widened(np.outer(farther, farther))
    return estimate, contradicted


def _parameter(
    name: str, fit: Estimate, parameters: Sequence[PhysicalParameter]
) -> PhysicalParameter:
    """What a name stands for; refused if the log leaves free what it depends on."""
    known = {p.name: p for p in parameters} | {c: Product(c, "", {c: 1}) for c in fit.names}
    if name not in known:
        raise SettingError("known", f"{name!r} is unknown here{did_you_mean(name, known)}")
    fitted = [c for c in known[name].coefficients if c in fit.names]
    if not fitted:
        raise SettingError("known", f"{name!r} follows from what was given: leave one of them out")
    for coefficient in fitted:
        place = fit.names.index(coefficient)
        if not np.isfinite(fit.covariance[place, place]):
            instead = "it" if name == coefficient else f"{coefficient!r} itself"
            raise SettingError(
                "known",
                f"{name!r} cannot be joined to a log that leaves {coefficient!r} free: give "
                f"{instead} without an uncertainty",
            )
    return known[name]


@dataclass(frozen=True, eq=False)
class _Linearised:
    """What is known, as functions of the coefficients, about a point."""

    names: tuple[str, ...]
    point: FloatArray
    given: Mapping[str, float]
    parameters: Sequence[PhysicalParameter]

    @property
    def _coefficients(self) -> dict[str, float]:
        return {**self.given, **dict(zip(self.names, self.point.tolist(), strict=True))}

    @property
    def values(self) -> FloatArray:
        """Values of the functions, shape (n_known,)."""
        return np.array([p.value(self._coefficients) for p in self.parameters])

    @property
    def slopes(self) -> FloatArray:
        """Their derivatives, shape (n_known, k)."""
        return np.array([p.gradient(self._coefficients, self.names) for p in self.parameters])


def _joined(
    alone: _Linearised, covariance: FloatArray, values: FloatArray, variances: FloatArray
) -> tuple[_Linearised, FloatArray]:
    """The most probable point, and the gain there: the step repeated until it ends."""
    here, shortest = alone, np.array([name in POSITIVE for name in alone.names])
    for _ in range(_STEPS):
        slopes = here.slopes
        spread = slopes @ covariance @ slopes.T + np.diag(variances)
        gain = covariance @ slopes.T @ pseudo_inverse(spread, _NULL)
        surprise = values - here.values - slopes @ (alone.point - here.point)
        step = alone.point + gain @ surprise - here.point
        size = np.abs(step) / np.maximum(np.abs(here.point), np.finfo(float).tiny)
        if np.all(size < _CONVERGED):
            return here, gain
        longest = float(np.max(size, where=shortest, initial=0.0))
        step *= min(1.0, _LARGEST_STEP / longest) if longest > 0.0 else 1.0
        here = replace(here, point=here.point + step)
    names = " and ".join(p.name for p in alone.parameters)
    raise ConvergenceError(
        "joining what is known",
        f"the log and what is known of {names} do not go together: check value and unit",
    )


def _contradictions(
    alone: _Linearised, covariance: FloatArray, known: Sequence[Known], limit: float
) -> dict[str, str]:
    slopes = alone.slopes
    found = {}
    for item, value, slope in zip(known, alone.values.tolist(), slopes, strict=True):
        variance = float(slope @ covariance @ slope)
        if abs(item.value - value) > limit * np.sqrt(variance + item.std**2):
            found[item.name] = contradiction_warning(item, value, float(np.sqrt(variance)))
    return found


def contradiction_warning(known: Known, value: float, std: float) -> str:
    """One sentence on a known value that the log contradicts."""
    stated = f"{known.value:.4g}" + (f" ± {known.std:.2g}" if known.std else "")
    verb = "is bounded by" if known.bound else "is known as"
    return (
        f"{known.name} {verb} {stated}, which contradicts the log: it says {value:.4g} ± "
        f"{std:.2g} by itself; check the value and the log's units"
    )


def _welch_satterthwaite(
    degrees_of_freedom: FloatArray, from_log: FloatArray, total: FloatArray
) -> FloatArray:
    """Degrees of freedom of variances of which only the log's part is estimated."""
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = degrees_of_freedom * (total / from_log) ** 2
    return np.where(from_log > 0.0, np.nan_to_num(freedom, nan=0.0, posinf=np.inf), np.inf)


Bounds = dict[str, tuple[float, float]]

_SAME = 1e-9  # relative difference of two statements of the same


@dataclass(frozen=True)
class Stated:
    """What is stated of a joint."""

    given: Mapping[str, float]  # coefficients that are known exactly
    bounds: Mapping[str, tuple[float, float]]  # ends of coefficients
    # what is to be joined to the fit: what is uncertain, and exact functions of several
    # coefficients
    known: tuple[Known, ...] = ()
    # ends of functions of several coefficients
    within: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # coefficients that all this is about, so that their terms stay
    kept: frozenset[str] = frozenset()


def stated(settings: Settings, joint: Joint, input_unit: str) -> Stated:
    """What the settings state of a joint with an input."""
    functions = _functions(settings, joint, input_unit)
    for setting, names in (("known", settings.known), ("bounds", settings.bounds)):
        for name in names:
            if name not in functions:
                raise _nothing_here(setting, name, functions, input_unit)
    exact = {n: v for n, v in settings.known.items() if not settings.known_deviations.get(n)}
    given, left = _solved({name: (functions[name], value) for name, value in exact.items()})
    uncertain = [
        Known(name, settings.known[name], deviation)
        for name, deviation in settings.known_deviations.items()
        if deviation > 0.0 and name in settings.known
    ]
    for item in uncertain:
        if {*functions[item.name].coefficients} <= given.keys():
            raise SettingError(
                "known", f"{item.name} follows from what else is known: leave it out"
            )
    bounds, within = _bounded(settings.bounds, functions, given)
    _check_uncertain(uncertain, functions, given, {**bounds, **settings.bounds})
    return Stated(
        given,
        bounds,
        (*(Known(name, exact[name], 0.0) for name in left), *uncertain),
        within,
        frozenset(c for n in (*settings.known, *settings.bounds) for c in _own(functions[n])),
    )


def _functions(settings: Settings, joint: Joint, input_unit: str) -> dict[str, PhysicalParameter]:
    """What may be stated of: coefficients and parameters of the terms that may be on."""
    on = [
        c
        for c in joint.units
        if settings.terms == "auto"
        or (term := joint.of_coefficient(c)) is None
        or term in settings.terms
    ]
    parameters = joint.parameters(on, input_unit)
    return {c: Product(c, "", {c: 1}) for c in on} | {p.name: p for p in parameters}


def _nothing_here(
    setting: str, name: str, functions: Mapping[str, PhysicalParameter], input_unit: str
) -> SettingError:
    here = ", ".join(functions)
    torque = "" if input_unit in FORCES else "; what is absolute needs a torque as the input"
    return SettingError(
        setting, f"this log and these terms have no {name}{torque}; there are {here}"
    )


def _own(function: PhysicalParameter) -> tuple[str, ...]:
    """Coefficients without which there is no such parameter; gravity may lie all in its sine."""
    if isinstance(function, Amplitude):
        return (function.first, *function.exponents)
    return function.coefficients


def _solved(
    exact: Mapping[str, tuple[PhysicalParameter, float]],
) -> tuple[dict[str, float], list[str]]:
    """Coefficients that follow, and the names of what is left as functions of several.

    A product of powers is a row of exponents. What is a combination of such rows follows from what
    they are known as.
    """
    products = {
        # Of a product that is zero what divides it is of no account.
        name: ({c: power for c, power in function.exponents.items() if value or power > 0}, value)
        for name, (function, value) in exact.items()
        if isinstance(function, Product)
    }
    coefficients = [*dict.fromkeys(c for powers, _ in products.values() for c in powers)]
    rows = np.array([[p.get(c, 0) for c in coefficients] for p, _ in products.values()])
    known = np.array([value for _, value in products.values()])
    for place, (name, value) in enumerate(zip(products, known.tolist(), strict=True)):
        follows = _combined(rows[:place], known[:place], rows[place])
        if follows is not None:
            same = isclose(follows, value, rel_tol=_SAME)
            advice = "leave it out" if same else f"that makes it {follows:.6g}"
            raise SettingError("known", f"{name} follows from what else is known: {advice}")
    alone = zip(coefficients, np.eye(len(coefficients)), strict=True)
    found = {c: _combined(rows, known, row) for c, row in alone}
    given = {c: value for c, value in found.items() if value is not None}
    for name, (powers, _) in products.items():
        if not all(isfinite(given[c]) for c in powers if c in given):
            raise SettingError("known", f"{name}: the value is impossible with what is known")
    solved = {name for name, (powers, _) in products.items() if powers.keys() <= given.keys()}
    return given, [name for name in exact if name not in solved]


def _combined(
    rows: FloatArray,  # (n, k): exponents
    values: FloatArray,  # (n,)
    wanted: FloatArray,  # (k,)
) -> float | None:
    """The product of powers that is wanted, where it is one of others with these values."""
    if not len(rows):
        return None
    powers = np.rint(np.linalg.lstsq(rows.T, wanted)[0])
    if np.any(powers @ rows != wanted):
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.prod(values**powers))


def _knowing(function: Product, given: Mapping[str, float]) -> tuple[float, dict[str, int]]:
    """What a product is of coefficients that are given, and the powers of the others."""
    left = {c: power for c, power in function.exponents.items() if c not in given}
    return function.value({**given, **dict.fromkeys(left, 1.0)}), left


def _bounded(
    wanted: Mapping[str, tuple[float, float]],
    functions: Mapping[str, PhysicalParameter],
    given: Mapping[str, float],
) -> tuple[Bounds, Bounds]:
    """Bounds of coefficients, and of what is a function of several unknown ones."""
    bounds: Bounds = {}
    within: Bounds = {}
    for name, (lower, upper) in wanted.items():
        function = functions[name]
        if {*function.coefficients} <= given.keys():
            value = function.value(given)
            if not lower <= value <= upper:
                raise SettingError(
                    "bounds",
                    f"{name} = {value:.6g} follows from what is known, and lies outside "
                    f"{lower:g}:{upper:g}: correct one of them",
                )
            continue
        if not isinstance(function, Product):
            within[name] = (lower, upper)
            continue
        factor, left = _knowing(function, given)
        if len(left) > 1:
            within[name] = (lower, upper)
            continue
        ((coefficient, power),) = left.items()
        ends = _ends(lower / factor, upper / factor, power)
        before = bounds.get(coefficient, (-inf, inf))
        found = (max(before[0], ends[0]), min(before[1], ends[1]))
        if not found[0] < found[1]:
            raise SettingError(
                "bounds", f"those of {name} leave no room beside the others: correct one of them"
            )
        bounds[coefficient] = found
    return bounds, within


def _ends(first: float, second: float, power: int) -> tuple[float, float]:
    """Ends of a coefficient from those of it or, for an inertia, of its inverse."""
    if power > 0:
        return min(first, second), max(first, second)
    lower, upper = max(0.0, min(first, second)), max(first, second)
    return (1.0 / upper if upper > 0.0 else inf), (1.0 / lower if lower > 0.0 else inf)


def _check_uncertain(
    uncertain: list[Known],
    functions: Mapping[str, PhysicalParameter],
    given: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]],
) -> None:
    """Refuse what is known as a value that its bounds exclude."""
    for item in uncertain:
        ends = bounds.get(item.name)
        value, name = item.value, item.name
        function = functions[item.name]
        if ends is None and isinstance(function, Product):
            factor, left = _knowing(function, given)
            if len(left) == 1:
                ((name, power),) = left.items()
                value, ends = (item.value / factor) ** power, bounds.get(name)
        if ends is not None and not ends[0] <= value <= ends[1]:
            raise SettingError(
                "bounds",
                f"{item.name} is known as {item.value:g}, so that {name} = {value:.6g} lies "
                f"outside {ends[0]:g}:{ends[1]:g}: correct one of them",
            )
