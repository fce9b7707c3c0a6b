"""What the user states of a drive, as far as it decides coefficients before anything is fitted.

A physical parameter is a function of coefficients. Where all of these but one are known exactly,
what is stated of the parameter is stated of that one: a known value fixes it, bounds become its
bounds, and the fit heeds them. What is stated of a function of several unknown coefficients is
joined to the fit afterwards (`prior_knowledge`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, isclose, isfinite

import numpy as np

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.identification.preparation.joint import Joint
from flexid.identification.preparation.prior_knowledge import Known
from flexid.identification.preparation.settings import Settings
from flexid.models.motion import FORCES
from flexid.models.parameter_kinds import Amplitude, PhysicalParameter, Product

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
