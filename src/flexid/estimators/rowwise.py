"""Least squares row by row, with a covariance that runs across the rows."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from flexid.arrays import FloatArray
from flexid.estimators.block_sandwich import block_influences
from flexid.estimators.scaled_inverse import scaled_inverse
from flexid.estimators.unknowns import Unknowns
from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class RowSums:
    """Least squares of one row, without the data that it was fitted to."""

    name: str  # name of the row
    coefficients: tuple[str, ...]  # names of what is sought in it, k of them; none if all is fixed
    gram: FloatArray  # (k, k): rᵀR of the regressors R as they were fitted
    inverse: FloatArray  # (k, k): its inverse on the directions that the data determine
    residual_sum: float  # sums of squares of the residual and of the left-hand side
    total_sum: float  # sums of squares of the residual and of the left-hand side
    # coefficients that the data leave free: their variance is infinite
    undetermined: tuple[str, ...]
    count: int  # equations that were fitted


@dataclass(frozen=True, eq=False)
class RowFit(RowSums):
    """Least squares of one row; as `RowSums`, and what was fitted."""

    regressors: FloatArray  # (k, n_equations): r, all recordings in turn
    # (n_equations,): what was fitted, less what is known or fixed; and its fit
    left_hand_side: FloatArray
    fitted: FloatArray  # (n_equations,): what was fitted, less what is known or fixed; and its fit


@dataclass(frozen=True, eq=False)
class RowwiseFit:
    """What is sought in all rows, with its covariance."""

    names: tuple[str, ...]  # what is sought, row by row
    values: FloatArray  # (n,): their values, in the system's units
    rows: tuple[RowFit, ...]  # the rows' own results
    blocks: tuple[int, ...]  # equations in each block of the covariance, independent of one another
    hold: Hold  # hold of the inputs

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
        return covariance_of_rows(self.rows, found)


def covariance_of_rows(
    rows: Sequence[RowSums], found: Sequence[tuple[FloatArray, FloatArray]]
) -> tuple[FloatArray, tuple[float, ...]]:
    """Covariance of all rows together, and the degrees of freedom of each variance."""
    influences = np.concatenate([influences for influences, _ in found])
    freedom = np.concatenate([freedom for _, freedom in found])
    covariance = influences @ influences.T
    names = [name for row in rows for name in row.coefficients]
    undetermined = {c for row in rows for c in row.undetermined}
    free = (freedom == 0.0) | np.array([name in undetermined for name in names])
    covariance[free, :] = covariance[:, free] = 0.0
    covariance[free, free] = np.inf
    return covariance, tuple(freedom.tolist())


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
        float(np.sum((left_hand_side - fitted) ** 2)),
        float(np.sum(left_hand_side**2)),
        tuple(c for c, is_free in zip(coefficients, free, strict=True) if is_free),
        len(left_hand_side),
        regressors,
        left_hand_side,
        fitted,
    )
    return fit, values
