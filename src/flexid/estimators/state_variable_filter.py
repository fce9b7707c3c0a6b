"""Least squares on positions through a state-variable filter: no accelerations, no velocities.

Every row v' = rᵀp + k is integrated twice over two sampling intervals, which turns v' into a second
difference of the position, and both sides are smoothed by the filter λ²/(s + λ)². What the filter
remembers from before the record is a combination of two known sequences, z^i and i z^i with its
pole z; both sides are projected on what these cannot explain, and p follows by least squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from flexid.errors import SettingError
from flexid.estimators.block_sandwich import block_influences, block_lengths
from flexid.estimators.samples import FloatArray, Samples
from flexid.estimators.scaled_inverse import scaled_inverse
from flexid.kernels.store import load_kernel, template
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_MEMORY = 40.0  # time constants of the filter after which its past has vanished: exp(-40) = 4e-18


@dataclass(frozen=True, eq=False)
class RowFit:
    """Least squares of one row.

    Parameters
    ----------
    name : str
        Name of the row.
    coefficients : tuple of str
        Names of its coefficients.
    gram : array, shape (k, k)
        RᵀR of the filtered regressors R, initial conditions projected out.
    degrees_of_freedom : int
        Blocks of the covariance less coefficients, for Student's t; 0 where there is no covariance.
    residual_sum, total_sum : float
        Sums of squares of the residual and of the filtered left-hand side.
    undetermined : tuple of str
        Coefficients that the data leave free: their variance is infinite.
    time, left_hand_side, fitted : array, shape (n_equations,)
        Filtered acceleration less known part, its fit, and when, all pieces in turn.
    """

    name: str
    coefficients: tuple[str, ...]
    gram: FloatArray
    degrees_of_freedom: int
    residual_sum: float
    total_sum: float
    undetermined: tuple[str, ...]
    time: FloatArray
    left_hand_side: FloatArray
    fitted: FloatArray


@dataclass(frozen=True, eq=False)
class LeastSquaresFit:
    """Coefficients of all rows with their covariance.

    Parameters
    ----------
    names : tuple of str
        Coefficients, row by row.
    values : array, shape (n,)
        Their values, in the system's units.
    covariance : array, shape (n, n)
        Rows correlate, since they share the noise of the positions; infinite variance marks what
        the data leave free.
    rows : tuple of RowFit
        The rows' own results.
    filter_rate : float
        λ in 1/s.
    hold : {"linear", "zero"}
        Hold of the inputs.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    rows: tuple[RowFit, ...]
    filter_rate: float
    hold: Hold

    @property
    def standard_deviations(self) -> FloatArray:
        """Standard deviation of each value, shape (n,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def degrees_of_freedom(self) -> tuple[int, ...]:
        """Degrees of freedom of each value's interval."""
        return tuple(row.degrees_of_freedom for row in self.rows for _ in row.coefficients)


def filtered_least_squares(
    pieces: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float = 20.0,
    hold: Hold = "linear",
) -> LeastSquaresFit:
    """Estimate all coefficients from contiguous pieces of motion.

    Parameters
    ----------
    pieces : sequence of Samples
        One or more. Velocities are used only where a regressor is nonlinear in them.
    system : ParametricSystem
        The model; its constants have the values declared in it.
    filter_rate : float, optional
        λ in 1/s. See `choose_filter_rate`.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.

    Returns
    -------
    LeastSquaresFit
        A coefficient that the data leave free has infinite variance and belongs to the solution
        of minimum norm (of the coefficients times their regressors' norms).

    Raises
    ------
    SettingError
        If the filter rate is not positive, or a regressor that is nonlinear in velocities meets a
        piece without velocities.
    """
    if not (np.isfinite(filter_rate) and filter_rate > 0.0):
        raise SettingError("filter rate", f"{filter_rate} is no rate: give a positive number, 1/s")
    usable = [piece for piece in pieces if len(piece) > 4]
    signals = filtered_signals(usable, system, filter_rate, hold)
    time = np.concatenate([np.zeros(0), *(piece.time[1:-1] for piece in usable)])
    lengths = [len(piece) - 2 for piece in usable]
    sample_times = [piece.sample_time for piece in usable]
    n_coefficients = len(system.coefficients)
    most = max(len(row.coefficients) for row in system.rows)
    blocks = block_lengths(lengths, sample_times, filter_rate, most)
    values = np.zeros(n_coefficients)
    influences = np.zeros((n_coefficients, len(blocks)))
    rows = []
    for place, (row, part) in enumerate(system.row_slices()):
        fit, values[part], influences[part] = _fit_row(
            row.name, row.coefficients, signals[part], signals[n_coefficients + place], blocks, time
        )
        rows.append(fit)
    covariance = influences @ influences.T
    free = [
        row.degrees_of_freedom == 0 or c in row.undetermined
        for row in rows
        for c in row.coefficients
    ]
    covariance[free, :] = covariance[:, free] = 0.0
    covariance[free, free] = np.inf
    return LeastSquaresFit(
        system.coefficients, values, covariance, tuple(rows), float(filter_rate), hold
    )


def filtered_signals(
    pieces: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float,
    hold: Hold,
) -> FloatArray:
    """Filtered regressors and left-hand sides, the filter's initial conditions projected out.

    Parameters are those of `filtered_least_squares`; every piece has at least three samples.

    Returns
    -------
    array, shape (n_coefficients + n_rows, n_equations)
        Regressors of all coefficients, then left-hand sides of all rows; a piece of n samples
        gives n - 2 equations.

    Raises
    ------
    SettingError
        If a regressor that is nonlinear in velocities meets a piece without velocities.
    """
    kernel = _kernel(system)
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    total = sum(len(piece) - 2 for piece in pieces)
    filtered = np.empty((kernel.N_SIGNALS, total))
    first = 0
    for piece in pieces:
        if piece.velocities is None and kernel.VELOCITY_NEEDED:
            raise SettingError(
                "velocities",
                f"the regressor of {kernel.VELOCITY_NEEDED[0]!r} is nonlinear in a velocity but "
                f"there are none: derive velocities first, or drop the term",
            )
        positions = np.ascontiguousarray(piece.positions, dtype=np.float64)
        velocities = np.zeros_like(positions) if piece.velocities is None else piece.velocities
        pole = np.exp(-filter_rate * piece.sample_time)
        kernel.filter_piece(
            positions,
            np.ascontiguousarray(velocities, dtype=np.float64),
            np.ascontiguousarray(piece.inputs, dtype=np.float64),
            constants,
            float(piece.sample_time),
            pole,
            hold == "zero",
            filtered,
            first,
        )
        stop = first + len(piece) - 2
        memory = int(np.ceil(_MEMORY / (filter_rate * piece.sample_time))) + 2
        _project_out_past(filtered[:, first : min(stop, first + memory)], pole)
        first = stop
    return filtered


def _project_out_past(signals: FloatArray, pole: float) -> None:
    """Remove from each signal, in place, what the filter may remember: z^i and i z^i."""
    i = np.arange(signals.shape[1])
    past, _ = np.linalg.qr(np.column_stack((pole**i, i * pole**i)))
    signals -= (signals @ past) @ past.T


def _kernel(system: ParametricSystem) -> ModuleType:
    def build() -> str:
        from flexid.derivation.regressor_classes import filter_functions

        source = filter_functions(system, "State-variable filter on positions")
        return source + "\n\n" + template("state_variable_filter")

    return load_kernel("state_variable_filter", [system.digest], build)


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
        degrees_of_freedom,
        float(np.sum(residual**2)),
        float(np.sum(left_hand_side**2)),
        tuple(c for c, is_free in zip(coefficients, free, strict=True) if is_free),
        time,
        left_hand_side,
        fitted,
    )
    return fit, values, influences
