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
from scipy.linalg import block_diag

from flexid.errors import SettingError
from flexid.estimators.block_sandwich import block_influences, block_lengths
from flexid.estimators.samples import FloatArray, Samples
from flexid.estimators.scaled_inverse import scaled_inverse
from flexid.estimators.unknowns import FIXED, Unknowns, unknowns_of
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
        Names of what is sought in it, k of them; none if all is fixed.
    gram : array, shape (k, k)
        RᵀR of the filtered regressors R, initial conditions projected out.
    degrees_of_freedom : int
        Blocks of the covariance less coefficients, for Student's t; 0 where there is no covariance.
    residual_sum, total_sum : float
        Sums of squares of the residual and of the filtered left-hand side.
    undetermined : tuple of str
        Coefficients that the data leave free: their variance is infinite.
    time, left_hand_side, fitted : array, shape (n_equations,)
        Filtered acceleration less what is known or fixed, its fit, and when, all pieces in turn.
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
    def information(self) -> FloatArray:
        """Gram matrix of all rows, shape (n, n): the sum of squares' quadratic form."""
        return np.asarray(block_diag(*(row.gram for row in self.rows)))

    @property
    def degrees_of_freedom(self) -> tuple[int, ...]:
        """Degrees of freedom of each value's interval."""
        return tuple(row.degrees_of_freedom for row in self.rows for _ in row.coefficients)


def filtered_least_squares(
    pieces: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float = 20.0,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
) -> LeastSquaresFit:
    """Estimate coefficients from contiguous pieces of motion.

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
    unknowns : Unknowns, optional
        What is sought, if not every coefficient of the system from all pieces together.

    Returns
    -------
    LeastSquaresFit
        A coefficient that the data leave free has infinite variance and belongs to the solution
        of minimum norm (of the coefficients times their regressors' norms).

    Raises
    ------
    SettingError
        If the filter rate is not positive, the unknowns are of another model, or a regressor that
        is nonlinear in velocities meets a piece without velocities and is not fixed at 0.
    """
    if not (np.isfinite(filter_rate) and filter_rate > 0.0):
        raise SettingError("filter rate", f"{filter_rate} is no rate: give a positive number, 1/s")
    unknowns = unknowns_of(system, len(pieces), unknowns)
    usable = [place for place, piece in enumerate(pieces) if len(piece) > 4]
    used = [pieces[place] for place in usable]
    _check_velocities(pieces, usable, unknowns)
    signals = filtered_signals(used, system, filter_rate, hold)
    lengths = [len(piece) - 2 for piece in used]
    regressors, left_hand_sides = _sought_signals(signals, unknowns, usable, lengths)
    time = np.concatenate([np.zeros(0), *(piece.time[1:-1] for piece in used)])
    most = max(len(unknowns.names_of(row)) for row in system.rows)
    blocks = block_lengths(lengths, [piece.sample_time for piece in used], filter_rate, most)
    values = np.zeros(len(unknowns.names))
    influences = np.zeros((len(values), len(blocks)))
    rows = []
    first = 0
    for row, left_hand_side in zip(system.rows, left_hand_sides, strict=True):
        names = unknowns.names_of(row)
        part = slice(first, first + len(names))
        fit, values[part], influences[part] = _fit_row(
            row.name, names, regressors[part], left_hand_side, blocks, time
        )
        rows.append(fit)
        first = part.stop
    covariance = influences @ influences.T
    free = [
        row.degrees_of_freedom == 0 or c in row.undetermined
        for row in rows
        for c in row.coefficients
    ]
    covariance[free, :] = covariance[:, free] = 0.0
    covariance[free, free] = np.inf
    return LeastSquaresFit(
        unknowns.names, values, covariance, tuple(rows), float(filter_rate), hold
    )


def filtered_signals(
    pieces: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float,
    hold: Hold,
) -> FloatArray:
    """Filtered regressors and left-hand sides, the filter's initial conditions projected out.

    Parameters are those of `filtered_least_squares`; every piece has at least three samples.
    Velocities are taken as zero where there are none.

    Returns
    -------
    array, shape (n_coefficients + n_rows, n_equations)
        Regressors of all coefficients, then left-hand sides of all rows; a piece of n samples
        gives n - 2 equations.
    """
    kernel = _kernel(system)
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    total = sum(len(piece) - 2 for piece in pieces)
    filtered = np.empty((kernel.N_SIGNALS, total))
    first = 0
    for piece in pieces:
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


def _check_velocities(pieces: Sequence[Samples], usable: Sequence[int], unknowns: Unknowns) -> None:
    """Refuse a piece without velocities where a term that is not switched off needs one."""
    needed = _kernel(unknowns.system).VELOCITY_NEEDED
    for place in usable:
        if pieces[place].velocities is not None:
            continue
        absent = unknowns.absent(place)
        for name in needed:
            if name not in absent:
                raise SettingError(
                    "velocities",
                    f"the regressor of {name!r} is nonlinear in a velocity but there are none: "
                    f"derive velocities first, or drop the term",
                )


def _sought_signals(
    signals: FloatArray, unknowns: Unknowns, usable: Sequence[int], lengths: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Regressors of what is sought, and left-hand sides less what is fixed.

    Parameters
    ----------
    signals : array, shape (n_coefficients + n_rows, n_equations)
        As of `filtered_signals`.
    unknowns : Unknowns
        What is sought.
    usable, lengths : sequence of int
        Places of the pieces that the signals are of, and the equations of each.

    Returns
    -------
    regressors : array, shape (n_names, n_equations)
        Zero in the pieces that an unknown has no part in.
    left_hand_sides : array, shape (n_rows, n_equations)
    """
    system = unknowns.system
    n_coefficients = len(system.coefficients)
    regressors = np.zeros((len(unknowns.names), signals.shape[1]))
    left_hand_sides = signals[n_coefficients:].copy()
    stop = 0
    for place, length in zip(usable, lengths, strict=True):
        equations = slice(stop, stop + length)
        stop = equations.stop
        columns = unknowns.columns(place)
        sought = columns != FIXED
        regressors[columns[sought], equations] = signals[:n_coefficients][sought, equations]
        fixed = unknowns.coefficients(np.zeros(len(unknowns.names)), place)
        for row, (_, part) in enumerate(system.row_slices()):
            # A term that is off stays out even where its regressor is not finite.
            for coefficient in part.start + np.flatnonzero(fixed[part]):
                left_hand_sides[row, equations] -= (
                    fixed[coefficient] * signals[coefficient, equations]
                )
    return regressors, left_hand_sides


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
