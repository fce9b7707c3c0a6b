"""An estimate: names, values, covariance and degrees of freedom, whatever it came from."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from flexid.arrays import FloatArray
from flexid.estimators.cluster_covariance import shrunken


@dataclass(frozen=True, eq=False)
class Estimate:
    """Values of what was sought, with their uncertainty."""

    names: tuple[str, ...]  # what was sought, k of them
    values: FloatArray  # (k,): their values
    # (k, k): of all that is doubted; infinite variance where the data leave a value free
    covariance: FloatArray
    degrees_of_freedom: tuple[float, ...]  # of each variance, for Student's t

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def by_name(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def scaled(self, factors: FloatArray) -> "Estimate":
        """The same with every standard deviation times a factor, shape (k,)."""
        finite = np.isfinite(np.diag(self.covariance))
        factors = np.where(finite, factors, 1.0)
        return replace(self, covariance=self.covariance * np.outer(factors, factors))

    def at_least(self, deviations: FloatArray | float) -> "Estimate":
        """The same with no standard deviation below another, shape (k,)."""
        with np.errstate(invalid="ignore", divide="ignore"):
            short = deviations / self.deviations
        return self.scaled(np.where(np.isfinite(short), np.maximum(short, 1.0), 1.0))

    def drawn_to(self, white: FloatArray) -> "Estimate":
        """The same with the covariance drawn towards that of white noise, shape (k, k)."""
        own = np.array(self.degrees_of_freedom)
        covariance, freedom = shrunken(self.covariance, white, own)
        return replace(self, covariance=covariance, degrees_of_freedom=tuple(freedom.tolist()))

    def turned(self, mixing: FloatArray) -> "Estimate":
        """The same with errors that are a mixture, shape (k, k), of those that are finite."""
        finite = np.isfinite(np.diag(self.covariance))
        part = np.ix_(finite, finite)
        covariance = self.covariance.copy()
        covariance[part] = mixing[part] @ covariance[part] @ mixing[part].T
        return replace(self, covariance=covariance)

    def without_knowledge_of(self, names: Collection[str]) -> "Estimate":
        """The same with infinite variance for some names."""
        lost = np.array([name in names for name in self.names], dtype=np.bool_)
        covariance = np.where(lost[:, None] | lost, 0.0, self.covariance)
        covariance[lost, lost] = np.inf
        return replace(self, covariance=covariance)

    def widened(self, more: FloatArray) -> "Estimate":
        """The same with a further covariance, shape (k, k), added to what is finite."""
        finite = np.isfinite(np.diag(self.covariance))
        added = np.where(np.outer(finite, finite), more, 0.0)
        return replace(self, covariance=self.covariance + added)

    def with_values(self, known: Mapping[str, float]) -> dict[str, float]:
        """Values by name, with others that were not sought."""
        return {**known, **self.by_name}
