"""Assumption (A4) of Huang (2003) as a degree: the condition number of the regressors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexid.arrays import FloatArray, plain
from flexid.errors import SimulationError
from flexid.estimators.normal_equations import eigen
from flexid.estimators.segmented_motion import Point, SegmentedMotion

WEAK_CONDITION = 1e3  # condition number of the normalised Gram matrix above which a warning is due

LOST_CONDITION = 1e5
"""Condition number above which the confounded coefficients cannot be distinguished."""

_SHARE = 0.1  # of the worst direction, from which on a coefficient counts as part of it


@dataclass(frozen=True)
class Excitation:
    """How well the coefficients of one row can be distinguished."""

    row: str  # name of the row
    coefficients: tuple[str, ...]  # names of the row's coefficients, n of them
    # (n,), of the normalised Gram matrix (unit diagonal), largest first; dimensionless
    singular_values: FloatArray
    # smallest eigenvalue of the mean of r rᵀ, in the regressors' own units: the level of
    # persistent excitation
    level: float
    # coefficients that make up the worst direction; empty when there is only one coefficient
    confounded: tuple[str, ...]
    # (n,), the worst excited direction, in the coefficients' own units and of arbitrary length: a
    # step along it changes the motion the least
    direction: FloatArray
    # largest correlation, in absolute value, between the estimates of two coefficients
    correlation: float
    # the two coefficients of that correlation; empty when there is only one
    correlated: tuple[str, ...]

    @property
    def condition_number(self) -> float:
        """Ratio of the largest to the smallest singular value; infinite if one vanishes."""
        smallest = self.singular_values[-1]
        return float(self.singular_values[0] / smallest) if smallest > 0 else float("inf")

    @property
    def document(self) -> dict[str, Any]:
        """All but the row's name, ready for JSON."""
        found = plain(self) | {"condition_number": plain(self.condition_number)}
        del found["row"]
        return found


def excitation(row: str, coefficients: Sequence[str], regressors: ArrayLike) -> Excitation:
    """Excitation of a row from its n regressors at m evenly spaced instants, shape (m, n)."""
    r = np.asarray(regressors, dtype=float)
    return excitation_of_gram(row, coefficients, r.T @ r / len(r))


def excitation_of_gram(row: str, coefficients: Sequence[str], gram: ArrayLike) -> Excitation:
    """Measure the excitation of a row from the mean of r rᵀ, shape (n, n)."""
    gram = np.asarray(gram, dtype=float)
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0] = 1.0
    normalised = gram / np.outer(scale, scale)
    eigenvalues, vectors = eigen(normalised)
    # A vanishing eigenvalue may come out as a negative number of rounding size
    singular_values = np.clip(eigenvalues[::-1], 0.0, None)
    worst = vectors[:, 0]
    several = len(coefficients) > 1
    confounded = tuple(
        name
        for name, share in zip(coefficients, worst**2, strict=True)
        if several and share >= _SHARE
    )
    correlation, correlated = _largest_correlation(coefficients, eigenvalues, vectors)
    return Excitation(
        row,
        tuple(coefficients),
        singular_values,
        float(max(np.linalg.eigvalsh(gram)[0], 0.0)),
        confounded,
        worst / scale,
        correlation,
        correlated,
    )


def _largest_correlation(
    coefficients: Sequence[str], eigenvalues: NDArray[np.float64], vectors: NDArray[np.float64]
) -> tuple[float, tuple[str, ...]]:
    if len(coefficients) < 2:
        return 0.0, ()
    rounding = np.finfo(float)
    floor = max(rounding.eps * eigenvalues[-1], rounding.tiny)  # nothing moves at all
    covariance = (vectors / np.maximum(eigenvalues, floor)) @ vectors.T
    deviation = np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance / np.outer(deviation, deviation))
    np.fill_diagonal(correlation, -1.0)  # below that of any two
    i, j = sorted(divmod(int(np.argmax(correlation)), len(coefficients)))
    return float(correlation[i, j]), (coefficients[i], coefficients[j])


@dataclass(frozen=True, eq=False)
class Information:
    """What positions tell about k coefficients."""

    names: tuple[str, ...]  # the coefficients, then delays that are sought
    values: FloatArray  # where it was computed
    matrix: FloatArray  # Fisher information, the initial states unknown
    covariance: FloatArray  # its inverse; infinite variance marks what the motion leaves free

    @property
    def standard_deviations(self) -> FloatArray:
        """Least standard deviation of each coefficient, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def relative_deviations(self) -> FloatArray:
        """The same over the coefficients' values; infinite for one that is zero."""
        with np.errstate(divide="ignore"):
            return self.standard_deviations / np.abs(self.values)

    @property
    def relative(self) -> FloatArray:
        """Information about the coefficients' logarithms, (k, k): that of relative errors."""
        return self.matrix * np.outer(self.values, self.values)


def information_at(problem: SegmentedMotion, point: Point) -> Information:
    """Information of a point's motion, its initial states unknown: the inverse Cramér-Rao bound."""
    equations = problem.equations(point)
    if not np.isfinite(equations.cost):
        raise SimulationError(
            "the model's motion diverges within a segment: check its coefficients",
            float(problem.segments.start_times[0]),
        )
    reduced = problem.solve(equations)
    covariance = reduced.inverse.copy()
    covariance[reduced.free, :] = covariance[:, reduced.free] = 0.0
    covariance[reduced.free, reduced.free] = np.inf
    return Information(problem.names, point.values, reduced.information, covariance)


def decay_rate(time: FloatArray, errors: FloatArray, window: float, floor: float) -> float:
    """Exponential rate in 1/s at which errors, (n, m), decay; NaN with fewer than three windows."""
    norm = np.linalg.norm(errors, axis=1)
    place = np.floor((time - time[0]) / window * (1 + 1e-12)).astype(int)
    starts = np.flatnonzero(np.diff(place, prepend=-1))
    envelope = np.maximum.reduceat(norm, starts)
    above = envelope > floor
    count = len(above) if above.all() else int(np.argmin(above))
    later = slice(count // 2, count)
    if count - count // 2 < 3:
        return float("nan")
    slope = np.polyfit(time[starts[later]], np.log(envelope[later]), 1)[0]
    return float(-slope)
