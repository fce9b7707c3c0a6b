"""Least squares row by row, with a covariance that runs across the rows."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from flexid.arrays import FloatArray
from flexid.estimators.cluster_covariance import block_influences, covariance_of
from flexid.estimators.normal_equations import scaled_inverse
from flexid.estimators.unknowns import Unknowns


@dataclass(frozen=True, eq=False)
class RowFit:
    """Least squares of one row."""

    name: str  # name of the row
    coefficients: tuple[str, ...]  # names of what is sought in it, k of them; none if all is fixed
    gram: FloatArray  # (k, k): rᵀR of the regressors R as they were fitted
    inverse: FloatArray  # (k, k): its inverse on the directions that the data determine
    total_sum: float  # sum of squares of the left-hand side
    # coefficients that the data leave free: their variance is infinite
    undetermined: tuple[str, ...]
    regressors: FloatArray  # (k, n_equations): r, all recordings in turn
    left_hand_side: FloatArray  # (n_equations,): what was fitted, less what is known or fixed
    fitted: FloatArray  # (n_equations,): its fit

    @property
    def count(self) -> int:
        """Equations that were fitted."""
        return len(self.left_hand_side)

    @property
    def residual_sum(self) -> float:
        """Sum of squares of what the fit leaves."""
        return float(np.sum((self.left_hand_side - self.fitted) ** 2))

    def over(self, some: NDArray[np.bool_]) -> FloatArray:
        """Least squares of some equations alone, shape (k,), from whether each is one of them."""
        regressors = self.regressors[:, some]
        gram = regressors @ regressors.T
        inverse, _ = scaled_inverse(gram, np.sqrt(np.diag(gram)))
        return inverse @ (regressors @ self.left_hand_side[some])


@dataclass(frozen=True, eq=False)
class LeastSquaresFit:
    """What is sought in all rows, with its covariance."""

    names: tuple[str, ...]  # what is sought, row by row
    values: FloatArray  # (n,): their values, in the system's units
    rows: tuple[RowFit, ...]  # the rows' own results
    blocks: tuple[int, ...]  # equations in each block of the covariance, independent of one another

    @property
    def by_name(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the values, shape (n, n).

        Rows correlate, since they share the noise of the positions. Infinite variance marks what
        the data leave free.
        """
        return self._uncertainty[0]

    @property
    def degrees_of_freedom(self) -> tuple[float, ...]:
        """Degrees of freedom of each variance, for Student's t; 0 where there is none."""
        return self._uncertainty[1]

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation of each value, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def information(self) -> FloatArray:
        """Gram matrix of all rows, shape (n, n): the sum of squares' quadratic form."""
        return np.asarray(block_diag(*(row.gram for row in self.rows)))

    @cached_property
    def _uncertainty(self) -> tuple[FloatArray, tuple[float, ...]]:
        """Covariance and degrees of freedom, made when asked for: many fits are only compared."""
        found = [
            block_influences(
                row.regressors, row.left_hand_side - row.fitted, row.inverse, self.blocks
            )
            for row in self.rows
        ]
        influences = np.concatenate([influences for influences, _ in found])
        freedom = np.concatenate([freedom for _, freedom in found])
        undetermined = {c for row in self.rows for c in row.undetermined}
        free = np.array([name in undetermined for name in self.names])
        return covariance_of(influences, (freedom == 0.0) | free), tuple(freedom.tolist())


def fit_rows(
    unknowns: Unknowns,
    regressors: FloatArray,  # (n_names, n_equations)
    left_hand_sides: FloatArray,  # (n_rows, n_equations)
) -> tuple[FloatArray, tuple[RowFit, ...]]:
    """Least squares of every row: values, shape (n_names,), and the fit of each row."""
    values = np.zeros(len(unknowns.names))
    rows = []
    first = 0
    for row, left_hand_side in zip(unknowns.system.rows, left_hand_sides, strict=True):
        names = unknowns.names_of(row)
        part = slice(first, first + len(names))
        fit, values[part] = _fit_row(row.name, names, regressors[part], left_hand_side)
        rows.append(fit)
        first = part.stop
    return values, tuple(rows)


def _fit_row(
    name: str, coefficients: tuple[str, ...], regressors: FloatArray, left_hand_side: FloatArray
) -> tuple[RowFit, FloatArray]:
    """Least squares of one row: its fit and values."""
    gram = regressors @ regressors.T
    scale = np.sqrt(np.diag(gram))
    inverse, free = scaled_inverse(gram, scale)
    values = inverse @ (regressors @ left_hand_side)
    # One refinement brings the normal equations to the accuracy of an orthogonal factorisation.
    values += inverse @ (regressors @ (left_hand_side - values @ regressors))
    fitted = values @ regressors
    fit = RowFit(
        name,
        coefficients,
        gram,
        inverse,
        float(np.sum(left_hand_side**2)),
        tuple(c for c, is_free in zip(coefficients, free, strict=True) if is_free),
        regressors,
        left_hand_side,
        fitted,
    )
    return fit, values
