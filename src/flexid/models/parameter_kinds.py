"""Physical parameters as functions of coefficients: what each is worth, and its derivatives."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from math import atan2, hypot, prod
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class PhysicalParameter(Protocol):
    """A function of some coefficients; ``{input}`` in its unit stands for the input's unit."""

    @property
    def name(self) -> str:
        """Its name."""
        ...

    @property
    def unit(self) -> str:
        """Its SI unit."""
        ...

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        ...

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Value of the parameter; infinite where a denominator is zero."""
        ...

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Derivative of the value with respect to the named coefficients, shape (n_names,)."""
        ...


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
class Directional:
    """A friction in one direction: (odd ± even coefficient) times a product."""

    name: str
    unit: str
    odd: str  # the coefficient whose force changes its sign with the direction
    even: str
    sign: float  # of the even one
    exponents: Mapping[str, int] = field(default_factory=dict)  # the product, of other coefficients
    # coefficients without which a model does not distinguish the directions
    beside: tuple[str, ...] = ()

    @property
    def _factor(self) -> Product:
        return Product(self.name, self.unit, self.exponents)

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return (self.odd, self.even, *self.exponents, *self.beside)

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Value of the parameter; infinite where a denominator is zero."""
        both = coefficients[self.odd] + self.sign * coefficients[self.even]
        return both * self._factor.value(coefficients)

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Derivative of the value with respect to the named coefficients, shape (n_names,)."""
        both = coefficients[self.odd] + self.sign * coefficients[self.even]
        weights = {self.odd: 1.0, self.even: self.sign}
        own = np.array([weights.get(name, 0.0) for name in names])
        factor = self._factor
        return both * factor.gradient(coefficients, names) + own * factor.value(coefficients)


@dataclass(frozen=True)
class Amplitude:
    """Amplitude of ``sine sin x + cosine cos x`` times a product, as that of a tilted gravity."""

    name: str
    unit: str
    sine: str
    cosine: str
    exponents: Mapping[str, int] = field(default_factory=dict)  # the product, of other coefficients

    @property
    def _factor(self) -> Product:
        return Product(self.name, self.unit, self.exponents)

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return (self.sine, self.cosine, *self.exponents)

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Value of the parameter; infinite where a denominator is zero."""
        amplitude = hypot(coefficients[self.sine], coefficients[self.cosine])
        return amplitude * self._factor.value(coefficients)

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Derivative by the named coefficients, shape (n_names,); NaN where both are zero."""
        pair = np.array([coefficients[self.sine], coefficients[self.cosine]])
        amplitude = hypot(*pair)
        gradient = amplitude * self._factor.gradient(coefficients, names)
        directions = pair / amplitude if amplitude else np.full(2, np.nan)
        for name, direction in zip((self.sine, self.cosine), directions, strict=True):
            here = np.array([n == name for n in names])
            gradient[here] = direction * self._factor.value(coefficients)
        return gradient


@dataclass(frozen=True)
class ZeroAngle:
    """The angle in rad at which ``sine sin x + cosine cos x`` passes zero, rising.

    For gravity this is the encoder's reading where the link hangs straight down.
    """

    name: str
    sine: str
    cosine: str
    unit: str = "rad"

    @property
    def coefficients(self) -> tuple[str, ...]:
        """Names of the coefficients it depends on."""
        return (self.sine, self.cosine)

    def value(self, coefficients: Mapping[str, float]) -> float:
        """Value in rad, within (-pi, pi]."""
        return -atan2(coefficients[self.cosine], coefficients[self.sine])

    def gradient(
        self, coefficients: Mapping[str, float], names: Collection[str]
    ) -> NDArray[np.float64]:
        """Derivative by the named coefficients, shape (n_names,); NaN where both are zero."""
        sine, cosine = coefficients[self.sine], coefficients[self.cosine]
        square = sine**2 + cosine**2
        by_name = {self.sine: cosine, self.cosine: -sine}
        return np.array([by_name.get(n, 0.0) / square if square else np.nan for n in names])
