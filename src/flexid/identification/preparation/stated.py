"""Prior knowledge of a drive: known values and bounds, before the fit and joined to the fit.

A physical parameter is a function of coefficients. If all of these but one are known exactly, a
known value of the parameter fixes the last one, and bounds of the parameter become its bounds. The
fit applies both. A known value or bound of a function of several unknown coefficients is joined to
the fit afterwards.

A coefficient or physical parameter g(p) that is known as v with standard deviation s is one more
measurement. With p̂ and C the fit's values and covariance, and h the gradient of g,

    K = C h / (hᵀC h + s²),    p = p̂ + K (v - g(p̂)),    C - K hᵀC

are the joint values and covariance. This is exact if g is linear and the noise normal. If g is not
linear, the step is repeated until it converges. The covariance of the fit allows for correlated
residuals, so the log has its correct weight. s = 0 fixes g(p) at v; a large s changes nothing.

If the log does not determine a coefficient at all, its C is infinite. A known value of it must then
be given as exact.
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
_NULL = 1e-15  # of the largest eigenvalue; smaller ones count as zero
_LEAST_FREEDOM = 0.5
_LARGEST_STEP = 0.5  # of a positive coefficient's value, so that it does not cross zero


@dataclass(frozen=True)
class Known:
    """A coefficient or physical parameter that is known beforehand."""

    name: str  # of the coefficient or physical parameter
    value: float
    std: float  # standard deviation of the value; 0 if it is known exactly
    bound: bool = False  # whether the value is a bound that the estimate would exceed

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
    """Join prior knowledge to a fit.

    Returns the joint estimate and, by name, a sentence for each known value that the log
    contradicts. Standard deviations of known values count as exact. So a value has the more degrees
    of freedom, the more it rests on known values (Welch and Satterthwaite).
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
    # A gain from an estimated covariance costs a degree of freedom, as in a regression: in the
    # remaining variance and in the gain's own error, the more the known values outweigh the log.
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
    if contradicted:  # the interval spans the log's value and the known one
        certain, _ = _joined(alone, covariance, values, np.zeros_like(variances))
        to_log, to_known = both.point - alone.point, certain.point - both.point
        farther = max((to_log, to_known), key=lambda c: float(np.linalg.norm(both.slopes @ c)))
        estimate = estimate.widened(np.outer(farther, farther))
    return estimate, contradicted


def _parameter(
    name: str, fit: Estimate, parameters: Sequence[PhysicalParameter]
) -> PhysicalParameter:
    """Return the parameter of a name; raise if the log does not determine its coefficients."""
    known = {p.name: p for p in parameters} | {c: Product(c, "", {c: 1}) for c in fit.names}
    if name not in known:
        raise SettingError("known", f"{name!r} is unknown here{did_you_mean(name, known)}")
    fitted = [c for c in known[name].coefficients if c in fit.names]
    if not fitted:
        raise SettingError("known", f"{name!r} follows from given values: leave one of them out")
    for coefficient in fitted:
        place = fit.names.index(coefficient)
        if not np.isfinite(fit.covariance[place, place]):
            instead = "it" if name == coefficient else f"{coefficient!r} itself"
            raise SettingError(
                "known",
                f"{name!r} cannot be joined, since the log leaves {coefficient!r} free: give "
                f"{instead} without an uncertainty",
            )
    return known[name]


@dataclass(frozen=True, eq=False)
class _Linearised:
    """Known parameters as functions of the coefficients, linearised about a point."""

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
        """Derivatives of the functions, shape (n_known, k)."""
        return np.array([p.gradient(self._coefficients, self.names) for p in self.parameters])


def _joined(
    alone: _Linearised, covariance: FloatArray, values: FloatArray, variances: FloatArray
) -> tuple[_Linearised, FloatArray]:
    """Return the most probable point and the gain there; steps repeat until they converge."""
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
        "joining known values",
        f"the log and the known {names} cannot be reconciled: check value and unit",
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
    """Return a sentence on a known value that the log contradicts."""
    stated = f"{known.value:.4g}" + (f" ± {known.std:.2g}" if known.std else "")
    verb = "is bounded by" if known.bound else "is known as"
    return (
        f"{known.name} {verb} {stated}, which contradicts the log: the log alone gives "
        f"{value:.4g} ± {std:.2g}; check the value and the log's units"
    )


def _welch_satterthwaite(
    degrees_of_freedom: FloatArray, from_log: FloatArray, total: FloatArray
) -> FloatArray:
    """Return degrees of freedom of total variances with an estimated part from the log."""
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = degrees_of_freedom * (total / from_log) ** 2
    return np.where(from_log > 0.0, np.nan_to_num(freedom, nan=0.0, posinf=np.inf), np.inf)


Bounds = dict[str, tuple[float, float]]

_SAME = 1e-9  # relative difference of two equal values


@dataclass(frozen=True)
class Stated:
    """Prior knowledge of a joint."""

    given: Mapping[str, float]  # coefficients that are known exactly
    bounds: Mapping[str, tuple[float, float]]  # bounds of coefficients
    # known values to be joined to the fit: uncertain ones, and exact functions of several
    # coefficients
    known: tuple[Known, ...] = ()
    # bounds of functions of several coefficients
    within: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # coefficients in any known value or bound; their terms stay in the model
    kept: frozenset[str] = frozenset()


def stated(settings: Settings, joint: Joint, input_unit: str) -> Stated:
    """Return the prior knowledge in the settings for a joint with an input."""
    functions = _functions(settings, joint, input_unit)
    for setting, names in (("known", settings.known), ("bounds", settings.bounds)):
        for name in names:
            if name not in functions:
                raise _unknown_name(setting, name, functions, input_unit)
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
                "known", f"{item.name} follows from other known values: leave it out"
            )
    bounds, within = _bounded(settings.bounds, functions, given)
    _check_uncertain(uncertain, functions, given, {**bounds, **settings.bounds})
    return Stated(
        given,
        bounds,
        (*(Known(name, exact[name], 0.0) for name in left), *uncertain),
        within,
        frozenset(c for n in (*settings.known, *settings.bounds) for c in _needed(functions[n])),
    )


def _functions(settings: Settings, joint: Joint, input_unit: str) -> dict[str, PhysicalParameter]:
    """Return the coefficients and parameters, by name, of all terms that may be on."""
    on = [
        c
        for c in joint.units
        if settings.terms == "auto"
        or (term := joint.of_coefficient(c)) is None
        or term in settings.terms
    ]
    parameters = joint.parameters(on, input_unit)
    return {c: Product(c, "", {c: 1}) for c in on} | {p.name: p for p in parameters}


def _unknown_name(
    setting: str, name: str, functions: Mapping[str, PhysicalParameter], input_unit: str
) -> SettingError:
    here = ", ".join(functions)
    torque = "" if input_unit in FORCES else "; absolute values need a torque as the input"
    return SettingError(
        setting, f"this log and these terms have no {name}{torque}; there are {here}"
    )


def _needed(function: PhysicalParameter) -> tuple[str, ...]:
    """Return the coefficients a parameter needs; an amplitude needs only its first part."""
    if isinstance(function, Amplitude):
        return (function.first, *function.exponents)
    return function.coefficients


def _solved(
    exact: Mapping[str, tuple[PhysicalParameter, float]],
) -> tuple[dict[str, float], list[str]]:
    """Return coefficients that exact values determine, and names of the remaining functions."""
    # A product of powers is a row of exponents. A product whose row is a combination of other rows
    # follows from the values of these.
    products = {
        # If a product is zero, its divisors do not matter.
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
            advice = "leave it out" if same else f"they make it {follows:.6g}"
            raise SettingError("known", f"{name} follows from other known values: {advice}")
    alone = zip(coefficients, np.eye(len(coefficients)), strict=True)
    found = {c: _combined(rows, known, row) for c, row in alone}
    given = {c: value for c, value in found.items() if value is not None}
    for name, (powers, _) in products.items():
        if not all(isfinite(given[c]) for c in powers if c in given):
            raise SettingError("known", f"{name}: the value is impossible with the known values")
    solved = {name for name, (powers, _) in products.items() if powers.keys() <= given.keys()}
    return given, [name for name in exact if name not in solved]


def _combined(
    rows: FloatArray,  # (n, k): exponents
    values: FloatArray,  # (n,)
    wanted: FloatArray,  # (k,)
) -> float | None:
    """Return the wanted product of powers from other products' values; None if independent."""
    if not len(rows):
        return None
    powers = np.rint(np.linalg.lstsq(rows.T, wanted)[0])
    if np.any(powers @ rows != wanted):
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.prod(values**powers))


def _known_factor(function: Product, given: Mapping[str, float]) -> tuple[float, dict[str, int]]:
    """Return a product's factor of given coefficients, and the powers of the others."""
    left = {c: power for c, power in function.exponents.items() if c not in given}
    return function.value({**given, **dict.fromkeys(left, 1.0)}), left


def _bounded(
    wanted: Mapping[str, tuple[float, float]],
    functions: Mapping[str, PhysicalParameter],
    given: Mapping[str, float],
) -> tuple[Bounds, Bounds]:
    """Return bounds of coefficients, and bounds of functions of several unknown ones."""
    bounds: Bounds = {}
    within: Bounds = {}
    for name, (lower, upper) in wanted.items():
        function = functions[name]
        if {*function.coefficients} <= given.keys():
            value = function.value(given)
            if not lower <= value <= upper:
                raise SettingError(
                    "bounds",
                    f"{name} = {value:.6g} follows from known values, and lies outside "
                    f"{lower:g}:{upper:g}: correct one of them",
                )
            continue
        if not isinstance(function, Product):
            within[name] = (lower, upper)
            continue
        factor, left = _known_factor(function, given)
        if len(left) > 1:
            within[name] = (lower, upper)
            continue
        ((coefficient, power),) = left.items()
        ends = _ends(lower / factor, upper / factor, power)
        before = bounds.get(coefficient, (-inf, inf))
        found = (max(before[0], ends[0]), min(before[1], ends[1]))
        if not found[0] < found[1]:
            raise SettingError(
                "bounds", f"those of {name} and the other bounds exclude each other: correct one"
            )
        bounds[coefficient] = found
    return bounds, within


def _ends(first: float, second: float, power: int) -> tuple[float, float]:
    """Return bounds of a coefficient from bounds of the coefficient or of its inverse."""
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
    """Raise if bounds exclude an uncertain known value."""
    for item in uncertain:
        ends = bounds.get(item.name)
        value, name = item.value, item.name
        function = functions[item.name]
        if ends is None and isinstance(function, Product):
            factor, left = _known_factor(function, given)
            if len(left) == 1:
                ((name, power),) = left.items()
                value, ends = (item.value / factor) ** power, bounds.get(name)
        if ends is not None and not ends[0] <= value <= ends[1]:
            raise SettingError(
                "bounds",
                f"{item.name} is known as {item.value:g}, so that {name} = {value:.6g} lies "
                f"outside {ends[0]:g}:{ends[1]:g}: correct one of them",
            )
