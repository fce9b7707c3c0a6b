"""Physical parameters as functions of coefficients: what each is worth, and its derivatives."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from math import atan2, hypot, inf, nan, prod

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Product:
    """A product of powers of coefficients: the usual physical parameter."""

    name: str
    unit: str  # in SI; ``{input}`` stands for the unit of the input
    exponents: Mapping[str, int]  # by coefficient

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return tuple(self.exponents)

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Value of the parameter; infinite where a denominator is zero, or as good as that."""
        try:
            return prod(coefficients[c] ** power for c, power in self.exponents.items())
        except (ZeroDivisionError, OverflowError):
            return float("inf")

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Derivative of the value with respect to the named coefficients, shape (n_names,)."""
        return np.array([self._derivative(name, coefficients) for name in names])

    def _derivative(self, name: str, coefficients: Mapping[str, float]) -> float:
        power = self.exponents.get(name, 0)
        if power == 0:
            return 0.0
        lowered = Product(self.name, self.unit, {**self.exponents, name: power - 1})
        return power * lowered.value(coefficients)


@dataclass(frozen=True)
class Pair:
    """A function of two coefficients times a product of others; its subclasses say which."""

    name: str
    unit: str  # in SI; ``{input}`` stands for the unit of the input
    first: str
    second: str
    exponents: Mapping[str, int] = field(default_factory=dict)  # of the product, by coefficient

    def _function(self, first: float, second: float) -> tuple[float, float, float]:
        """Value of the function, and its derivatives by the two."""
        raise NotImplementedError

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return (self.first, self.second, *self.exponents)

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Value of the parameter; infinite where a denominator is zero."""
        value, *_ = self._function(coefficients[self.first], coefficients[self.second])
        return value * Product(self.name, self.unit, self.exponents).value(coefficients)

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Derivative by the named coefficients, shape (n_names,); NaN where there is none."""
        value, *slopes = self._function(coefficients[self.first], coefficients[self.second])
        factor = Product(self.name, self.unit, self.exponents)
        gradient = value * factor.gradient(coefficients, names)
        for name, slope in zip((self.first, self.second), slopes, strict=True):
            gradient[[n == name for n in names]] += slope * factor.value(coefficients)
        return gradient


@dataclass(frozen=True)
class Amplitude(Pair):
    """Amplitude of ``first sin x + second cos x`` times a product, as that of a tilted gravity."""

    def _function(self, first: float, second: float) -> tuple[float, float, float]:
        size = hypot(first, second)
        return size, first / size if size else nan, second / size if size else nan


@dataclass(frozen=True)
class ZeroAngle(Pair):
    """The angle in rad at which ``first sin x + second cos x`` passes zero, rising.

    It lies within (-pi, pi]. For gravity it is the encoder's reading where the link hangs straight
    down.
    """

    def _function(self, first: float, second: float) -> tuple[float, float, float]:
        square = first**2 + second**2
        angle = -atan2(second, first)
        return angle, second / square if square else nan, -first / square if square else nan


@dataclass(frozen=True)
class Directional(Pair):
    """A friction in one direction: first + sign second, times a product.

    The force of the first changes its sign with the direction.
    """

    sign: float = 1.0
    # coefficients without which a model does not distinguish the directions
    beside: tuple[str, ...] = ()

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return (*super().coefficients, *self.beside)

    def _function(self, first: float, second: float) -> tuple[float, float, float]:
        return first + self.sign * second, 1.0, self.sign


@dataclass(frozen=True)
class Quotient:
    """A coefficient over a weighted sum of others."""

    name: str
    unit: str
    numerator: str
    weights: Mapping[str, float]  # of the sum, by coefficient

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return (self.numerator, *self.weights)

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Value of the parameter; infinite where the sum is zero."""
        total = self._total(coefficients)
        return coefficients[self.numerator] / total if total else inf

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Derivative by the named coefficients, shape (n_names,); infinite as the value."""
        total, value = self._total(coefficients), self.value(coefficients)
        if not total:
            return np.full(len(names), inf)
        return np.array(
            [((n == self.numerator) - value * self.weights.get(n, 0.0)) / total for n in names]
        )

    def _total(self, coefficients: Mapping[str, float]) -> float:
        return sum(weight * coefficients[name] for name, weight in self.weights.items())


PhysicalParameter = Product | Pair | Quotient
"""A function of some coefficients."""
