"""Physical parameters of a joint from its lumped coefficients and back, with their derivatives."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from math import atan2, hypot, inf, nan, pi, prod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from flexid.models.flexible_joint import CONTENTS, DECLARED


@dataclass(frozen=True)
class Product:
    """Product of powers of coefficients: the usual physical parameter."""

    name: str
    unit: str  # in SI; ``{input}`` stands for the unit of the input
    exponents: Mapping[str, int]  # by coefficient

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return tuple(self.exponents)

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Return the value of the parameter; infinite if a denominator is zero or tiny."""
        try:
            return prod(coefficients[c] ** power for c, power in self.exponents.items())
        except (ZeroDivisionError, OverflowError):
            return float("inf")

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Return the derivatives of the value by the named coefficients, shape (n_names,)."""
        found = np.zeros(len(names))
        for place, name in enumerate(names):
            if power := self.exponents.get(name, 0):
                lowered = replace(self, exponents={**self.exponents, name: power - 1})
                found[place] = power * lowered.value(coefficients)
        return found


@dataclass(frozen=True)
class Pair:
    """Function of two coefficients, defined by subclasses, times a product of others."""

    name: str
    unit: str  # in SI; ``{input}`` stands for the unit of the input
    first: str
    second: str
    exponents: Mapping[str, int] = field(default_factory=dict)  # of the product, by coefficient

    def _function(self, first: float, second: float) -> tuple[float, float, float]:
        """Value of the function, and its derivatives by the two coefficients."""
        raise NotImplementedError

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return (self.first, self.second, *self.exponents)

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Return the value of the parameter; infinite if a denominator is zero."""
        value, *_ = self._function(coefficients[self.first], coefficients[self.second])
        return value * Product(self.name, self.unit, self.exponents).value(coefficients)

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Return derivatives by the named coefficients, shape (n_names,); NaN if undefined."""
        value, *slopes = self._function(coefficients[self.first], coefficients[self.second])
        factor = Product(self.name, self.unit, self.exponents)
        gradient = value * factor.gradient(coefficients, names)
        for name, slope in zip((self.first, self.second), slopes, strict=True):
            gradient[[n == name for n in names]] += slope * factor.value(coefficients)
        return gradient


@dataclass(frozen=True)
class Amplitude(Pair):
    """Amplitude of ``first sin x + second cos x`` times a product, such as gravity's torque."""

    def _function(self, first: float, second: float) -> tuple[float, float, float]:
        size = hypot(first, second)
        return size, first / size if size else nan, second / size if size else nan


@dataclass(frozen=True)
class ZeroAngle(Pair):
    """Angle within (-pi, pi] at which ``first sin x + second cos x`` passes zero, rising."""

    def _function(self, first: float, second: float) -> tuple[float, float, float]:
        square = first**2 + second**2
        angle = -atan2(second, first)
        return angle, second / square if square else nan, -first / square if square else nan


@dataclass(frozen=True)
class Directional(Pair):
    """Friction in one direction: (first + sign second) times a product."""

    sign: float = 1.0
    # further coefficients of a model that distinguishes the directions
    beside: tuple[str, ...] = ()

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return (*super().coefficients, *self.beside)

    def _function(self, first: float, second: float) -> tuple[float, float, float]:
        return first + self.sign * second, 1.0, self.sign


@dataclass(frozen=True)
class Quotient:
    """Coefficient over a weighted sum of others."""

    name: str
    unit: str
    numerator: str
    weights: Mapping[str, float]  # of the sum, by coefficient

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return (self.numerator, *self.weights)

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Return the value of the parameter; infinite if the sum is zero."""
        total = self._total(coefficients)
        return coefficients[self.numerator] / total if total else inf

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Return derivatives by the named coefficients, (n_names,); infinite if the value is."""
        total, value = self._total(coefficients), self.value(coefficients)
        if not total:
            return np.full(len(names), inf)
        return np.array(
            [((n == self.numerator) - value * self.weights.get(n, 0.0)) / total for n in names]
        )

    def _total(self, coefficients: Mapping[str, float]) -> float:
        return sum(weight * coefficients[name] for name, weight in self.weights.items())


@dataclass(frozen=True)
class Sum:
    """Sum of products, which a log may determine even if it determines none of them."""

    name: str
    unit: str
    parts: tuple[Product, ...]

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return tuple(dict.fromkeys(c for part in self.parts for c in part.coefficients))

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Return the value of the parameter; infinite if a denominator is zero."""
        return sum(part.value(coefficients) for part in self.parts)

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Return the derivatives of the value by the named coefficients, shape (n_names,)."""
        return np.sum([part.gradient(coefficients, names) for part in self.parts], axis=0)


PhysicalParameter = Product | Pair | Quotient | Sum  # a function of some coefficients


_KINDS = {
    "product": Product,
    "amplitude": Amplitude,
    "zero_angle": ZeroAngle,
    "directional": Directional,
    "sum": Sum,
}


def _declared(table: list[dict[str, Any]]) -> tuple[PhysicalParameter, ...]:
    found: list[PhysicalParameter] = []
    for content in table:
        kind = content.get("kind", "product")
        rest = {key: value for key, value in content.items() if key != "kind"}
        if kind == "sum":
            by_name = {p.name: p for p in found if isinstance(p, Product)}
            rest["parts"] = tuple(by_name[name] for name in content["parts"])
        found.append(_KINDS[kind](**rest))
    return tuple(found)


# Most parameters are products of powers, such as ke = alpha1 / beta1 and Jl = ke / theta2 of Huang
# (2003), section 3. If the input is no torque, only ratios are known.
_TABLES: Mapping[str, tuple[PhysicalParameter, ...]] = {
    name: _declared(table) for name, table in DECLARED["parameters"].items()
}

ANGLES = frozenset(p.name for table in _TABLES.values() for p in table if isinstance(p, ZeroAngle))
"""Parameters that are angles: their differences are modulo 2π, and percentages are meaningless."""

AMPLITUDES = frozenset(
    p.name for table in _TABLES.values() for p in table if isinstance(p, Amplitude)
)
"""Parameters that are amplitudes, which do not depend on the origin of an angle."""

PARAMETER_NAMES = tuple(dict.fromkeys(p.name for table in _TABLES.values() for p in table))
"""Names of all physical parameters, for every kind of joint and input."""


def values_with(coefficients: Collection[str]) -> frozenset[str]:
    """Return the names of coefficients, and of the parameters of any joint that need one."""
    every = (p for table in _TABLES.values() for p in table)
    needing = {p.name for p in every if not {*coefficients}.isdisjoint(p.coefficients)}
    return frozenset({*coefficients, *needing})


def physical_parameters(
    coefficients: Collection[str],
    input_is_torque: bool,
    kind: Literal["flexible", "rigid", "link"] = "flexible",
) -> tuple[PhysicalParameter, ...]:
    """Return the physical parameters of some coefficients; ratios if the input is no torque."""
    known = "with_torque" if input_is_torque and kind != "link" else "ratios"
    table = _TABLES[known if kind == "flexible" else f"{kind}_{known}"]
    # A later entry of the same name uses more coefficients and replaces the earlier one.
    found = {p.name: p for p in table if set(p.coefficients) <= set(coefficients)}
    return tuple(found.values())


def difference(name: str, a: float, b: float) -> float:
    """Return b - a, for an angle the shorter way round."""
    value = b - a
    return (value + pi) % (2.0 * pi) - pi if name in ANGLES else value


TERM_PARAMETERS: Mapping[str, str] = {
    name: content["parameter"]
    for name, content in DECLARED["terms"].items()
    if "parameter" in content
}
"""Physical parameter of each term that has one."""

_LINK, _MOTOR = (
    {
        c: content["parameter"]
        for content in CONTENTS
        if "parameter" in content
        for c in content.get(side, {})
    }
    for side in ("link", "motor")
)
"""Parameter that, divided by its side's inertia, gives each coefficient."""


def joint_coefficients(parameters: Mapping[str, float]) -> dict[str, float]:
    """Return coefficients of a flexible joint from physical parameters, with both inertias."""
    link = {
        c: parameters[n] / parameters["link_inertia"] for c, n in _LINK.items() if n in parameters
    }
    motor = {
        c: parameters[n] / parameters["motor_inertia"] for c, n in _MOTOR.items() if n in parameters
    }
    return link | motor | {"beta1": 1 / parameters["motor_inertia"]}
