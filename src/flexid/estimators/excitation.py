"""Excitation, assumption (A4) of Huang (2003), as the condition number of the regressors."""

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

_SHARE = 0.1  # smallest squared component of a confounded coefficient in the worst direction


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
        """Fields without the row's name, and the condition number, as a JSON document."""
        found = plain(self) | {"condition_number": plain(self.condition_number)}
        del found["row"]
        return found


def excitation(row: str, coefficients: Sequence[str], regressors: ArrayLike) -> Excitation:
    """Measure the excitation of a row from its n regressors at m even instants, shape (m, n)."""
    r = np.asarray(regressors, dtype=float)
    return excitation_of_gram(row, coefficients, r.T @ r / len(r))


def excitation_of_gram(row: str, coefficients: Sequence[str], gram: ArrayLike) -> Excitation:
    """Measure the excitation of a row from the mean of r rᵀ, shape (n, n)."""
    gram = np.asarray(gram, dtype=float)
    scale = np.sqrt(np.diag(gram))
    scale[scale == 0] = 1.0
    normalised = gram / np.outer(scale, scale)
    eigenvalues, vectors = eigen(normalised)
    # Rounding may make a vanishing eigenvalue negative.
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
    floor = max(rounding.eps * eigenvalues[-1], rounding.tiny)  # regressors may all be zero
    covariance = (vectors / np.maximum(eigenvalues, floor)) @ vectors.T
    deviation = np.sqrt(np.diag(covariance))
    correlation = np.abs(covariance / np.outer(deviation, deviation))
    np.fill_diagonal(correlation, -1.0)  # below every correlation of two coefficients
    i, j = sorted(divmod(int(np.argmax(correlation)), len(coefficients)))
    return float(correlation[i, j]), (coefficients[i], coefficients[j])


@dataclass(frozen=True, eq=False)
class Information:
    """Fisher information of measured positions about k unknowns."""

    names: tuple[str, ...]  # coefficients, then unknown delays
    values: FloatArray  # (k,): values at which the information was computed
    matrix: FloatArray  # (k, k): Fisher information; initial states are nuisance parameters
    covariance: FloatArray  # (k, k): inverse of `matrix`; infinite variance if undetermined

    @property
    def standard_deviations(self) -> FloatArray:
        """Smallest possible standard deviation of each unknown, shape (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def relative_deviations(self) -> FloatArray:
        """Standard deviations over absolute values, shape (k,); infinite for a value of zero."""
        with np.errstate(divide="ignore"):
            return self.standard_deviations / np.abs(self.values)

    @property
    def relative(self) -> FloatArray:
        """Information about the unknowns' logarithms, thus about relative errors, shape (k, k)."""
        return self.matrix * np.outer(self.values, self.values)


def information_at(problem: SegmentedMotion, point: Point) -> Information:
    """Return the Fisher information of the motion at a point, with unknown initial states."""
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
    """Fit the exponential decay rate in 1/s of errors, (n, m); NaN below three windows."""
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
