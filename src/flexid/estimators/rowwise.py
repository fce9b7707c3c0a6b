"""Least squares row by row, with a covariance that runs across the rows."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from flexid.estimators.block_sandwich import block_influences
from flexid.estimators.samples import FloatArray
from flexid.estimators.scaled_inverse import scaled_inverse
from flexid.estimators.unknowns import Unknowns
from flexid.recording.recording import Hold


@dataclass(frozen=True, eq=False)
class RowFit:
    """Least squares of one row.

    Parameters
    ----------
    name : str
        Name of the row.
    coefficients : tuple of str
        Names of what is sought in it, k of them; none if all is fixed.
    gram : array, shape (k, k)
        RᵀR of the regressors R as they were fitted.
    degrees_of_freedom : tuple of float
        Of each coefficient's variance, for Student's t; 0 where there is none.
    residual_sum, total_sum : float
        Sums of squares of the residual and of the left-hand side.
    undetermined : tuple of str
        Coefficients that the data leave free: their variance is infinite.
    time, left_hand_side, fitted : array, shape (n_equations,)
        What was fitted, less what is known or fixed; its fit; and when, all pieces in turn.
    """

    name: str
    coefficients: tuple[str, ...]
    gram: FloatArray
    degrees_of_freedom: tuple[float, ...]
    residual_sum: float
    total_sum: float
    undetermined: tuple[str, ...]
    time: FloatArray
    left_hand_side: FloatArray
    fitted: FloatArray


@dataclass(frozen=True, eq=False)
class RowwiseFit:
    """What is sought in all rows, with its covariance.

    Parameters
    ----------
    names : tuple of str
        What is sought, row by row.
    values : array, shape (n,)
        Their values, in the system's units.
    covariance : array, shape (n, n)
        Rows correlate, since they share the noise of the positions; infinite variance marks what
        the data leave free.
    rows : tuple of RowFit
        The rows' own results.
    hold : {"linear", "zero"}
        Hold of the inputs.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    rows: tuple[RowFit, ...]
    hold: Hold

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation of each value, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def information(self) -> FloatArray:
        """Gram matrix of all rows, shape (n, n): the sum of squares' quadratic form."""
        return np.asarray(block_diag(*(row.gram for row in self.rows)))

    @property
    def degrees_of_freedom(self) -> tuple[float, ...]:
        """Degrees of freedom of each value's interval."""
        return tuple(freedom for row in self.rows for freedom in row.degrees_of_freedom)


def fit_rows(
    unknowns: Unknowns,
    regressors: FloatArray,
    left_hand_sides: FloatArray,
    blocks: Sequence[int],
    time: FloatArray,
) -> tuple[FloatArray, FloatArray, tuple[RowFit, ...]]:
    """Least squares of every row.

    Parameters
    ----------
    unknowns : Unknowns
        What is sought.
    regressors : array, shape (n_names, n_equations)
        Of what is sought.
    left_hand_sides : array, shape (n_rows, n_equations)
        Less what is known or fixed.
    blocks : sequence of int
        Equations in each block of the covariance, independent of one another.
    time : array, shape (n_equations,)
        When.

    Returns
    -------
    values : array, shape (n_names,)
    covariance : array, shape (n_names, n_names)
    rows : tuple of RowFit
    """
    values = np.zeros(len(unknowns.names))
    influences = np.zeros((len(values), len(blocks)))
    rows = []
    first = 0
    for row, left_hand_side in zip(unknowns.system.rows, left_hand_sides, strict=True):
        names = unknowns.names_of(row)
        part = slice(first, first + len(names))
        fit, values[part], influences[part] = _fit_row(
            row.name, names, regressors[part], left_hand_side, blocks, time
        )
        rows.append(fit)
        first = part.stop
    covariance = influences @ influences.T
    free = [
        freedom == 0.0 or c in row.undetermined
        for row in rows
        for c, freedom in zip(row.coefficients, row.degrees_of_freedom, strict=True)
    ]
    covariance[free, :] = covariance[:, free] = 0.0
    covariance[free, free] = np.inf
    return values, covariance, tuple(rows)


def _fit_row(
    name: str,
    coefficients: tuple[str, ...],
    regressor: FloatArray,
    left_hand_side: FloatArray,
    blocks: Sequence[int],
    time: FloatArray,
) -> tuple[RowFit, FloatArray, FloatArray]:
    """Least squares of one row: its fit, values and the blocks' influences on them."""
    gram = regressor @ regressor.T
    scale = np.sqrt(np.diag(gram))
    inverse, free = scaled_inverse(gram, np.where(scale > 0.0, scale, 1.0))
    values = inverse @ (regressor @ left_hand_side)
    # One refinement brings the normal equations to the accuracy of an orthogonal factorisation.
    values += inverse @ (regressor @ (left_hand_side - values @ regressor))
    fitted = values @ regressor
    residual = left_hand_side - fitted
    influences, degrees_of_freedom = block_influences(regressor, residual, inverse, blocks)
    fit = RowFit(
        name,
        coefficients,
        gram,
        tuple(degrees_of_freedom.tolist()),
        float(np.sum(residual**2)),
        float(np.sum(left_hand_side**2)),
        tuple(c for c, is_free in zip(coefficients, free, strict=True) if is_free),
        time,
        left_hand_side,
        fitted,
    )
    return fit, values, influences
