"""Least squares on positions through a state-variable filter: no accelerations, no velocities.

Every row v' = rᵀp + k is integrated twice over two sampling intervals, which turns v' into a second
difference of the position, and both sides are smoothed by the filter λ²/(s + λ)². What the filter
remembers from before the record is a combination of two known sequences, z^i and i z^i with its
pole z; both sides are projected on what these cannot explain, and p follows by least squares.
"""

from collections.abc import Sequence
from types import ModuleType

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.block_sandwich import block_lengths
from flexid.estimators.rowwise import LeastSquaresFit, fit_rows
from flexid.estimators.samples import Samples
from flexid.estimators.unknowns import FIXED, Unknowns, unknowns_of
from flexid.kernels.store import load_kernel
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_MEMORY = 40.0  # time constants of the filter after which its past has vanished: exp(-40) = 4e-18


def filtered_least_squares(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float = 20.0,
    hold: Hold = "linear",
    unknowns: Unknowns | None = None,
) -> LeastSquaresFit:
    """Estimate coefficients from contiguous recordings of motion.

    Parameters
    ----------
    recordings : sequence of Samples
        One or more. Velocities are used only where a regressor is nonlinear in them.
    system : ParametricSystem
        The model; its constants have the values declared in it.
    filter_rate : float, optional
        λ in 1/s.
    hold : {"linear", "zero"}, optional
        Whether the inputs run linearly between samples or are constant until the next one.
    unknowns : Unknowns, optional
        What is sought, if not every coefficient of the system from all recordings together.

    Returns
    -------
    LeastSquaresFit
        A coefficient that the data leave free has infinite variance and belongs to the solution
        of minimum norm (of the coefficients times their regressors' norms).

    Raises
    ------
    SettingError
        If the filter rate is not positive, the unknowns are of another model, or a regressor that
        is nonlinear in velocities meets a recording without velocities and is not fixed at 0.
    """
    if not (np.isfinite(filter_rate) and filter_rate > 0.0):
        raise SettingError("filter rate", f"must be above 0 1/s, got {filter_rate}")
    unknowns = unknowns_of(system, len(recordings), unknowns)
    usable = [place for place, recording in enumerate(recordings) if len(recording) > 4]
    used = [recordings[place] for place in usable]
    _check_velocities(recordings, usable, unknowns)
    wanted = _wanted_signals(unknowns, usable)
    signals = filtered_signals(used, system, filter_rate, hold, wanted)
    lengths = [len(recording) - 2 for recording in used]
    regressors, left_hand_sides = _sought_signals(signals, unknowns, usable, lengths)
    most = max(len(unknowns.names_of(row)) for row in system.rows)
    blocks = block_lengths(
        lengths, [recording.sample_time for recording in used], filter_rate, most
    )
    values, rows = fit_rows(unknowns, regressors, left_hand_sides)
    return LeastSquaresFit(unknowns.names, values, rows, tuple(blocks))


def filtered_signals(
    recordings: Sequence[Samples],
    system: ParametricSystem,
    filter_rate: float,
    hold: Hold,
    wanted: NDArray[np.int64] | None = None,
) -> FloatArray:
    """Filtered regressors and left-hand sides, the filter's initial conditions projected out.

    Parameters are those of `filtered_least_squares`, and the places of the signals that are wanted
    if not all are: the others are zero. Every recording has at least three samples. Velocities are
    taken as zero where there are none.
    """
    equations = [len(recording) - 2 for recording in recordings]
    kernel = _kernel(system)
    if wanted is None:
        wanted = np.arange(kernel.N_SIGNALS, dtype=np.int64)
    constants = np.array(list(system.constants.values()), dtype=np.float64)
    # Memory that nothing is written to takes no room: signals that are not wanted cost nothing.
    signals = np.zeros((len(system.coefficients) + len(system.rows), sum(equations)))
    first = 0
    for recording, count in zip(recordings, equations, strict=True):
        h = float(recording.sample_time)
        pole = float(np.exp(-filter_rate * h))
        none = np.zeros_like(recording.positions)
        velocities = none if recording.velocities is None else recording.velocities
        record = tuple(
            np.ascontiguousarray(column, dtype=np.float64)
            for column in (recording.positions, velocities, recording.inputs)
        )
        kernel.filter_recording(record, constants, h, pole, hold == "zero", wanted, signals, first)
        past = min(count, int(np.ceil(_MEMORY / (filter_rate * h))) + 2)
        _project_out_past(signals[:, first : first + past], pole)
        first += count
    return signals


def _project_out_past(signals: FloatArray, pole: float) -> None:
    """Remove from each signal, in place, what the filter may remember: z^i and i z^i."""
    i = np.arange(signals.shape[1])
    past, _ = np.linalg.qr(np.column_stack((pole**i, i * pole**i)))
    signals -= (signals @ past) @ past.T


def _check_velocities(
    recordings: Sequence[Samples], usable: Sequence[int], unknowns: Unknowns
) -> None:
    """Refuse a recording without velocities where a term that is not switched off needs one."""
    needed = _kernel(unknowns.system).VELOCITY_NEEDED
    for place in usable:
        if recordings[place].velocities is not None:
            continue
        absent = unknowns.absent(place)
        for name in needed:
            if name not in absent:
                raise SettingError(
                    "velocities",
                    f"the regressor of {name!r} is nonlinear in a velocity but there are none: "
                    f"derive velocities first, or drop the term",
                )


def _wanted_signals(unknowns: Unknowns, usable: Sequence[int]) -> NDArray[np.int64]:
    """Places of the signals of least squares: left-hand sides, and regressors that are on."""
    system = unknowns.system
    absent = [unknowns.absent(place) for place in usable] or [frozenset()]
    off = frozenset.intersection(*absent)
    coefficients = [i for i, name in enumerate(system.coefficients) if name not in off]
    rows = [len(system.coefficients) + j for j in range(len(system.rows))]
    return np.array(coefficients + rows, dtype=np.int64)


def _sought_signals(
    signals: FloatArray, unknowns: Unknowns, usable: Sequence[int], lengths: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Regressors of what is sought, and left-hand sides less what is fixed."""
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


def _kernel(system: ParametricSystem) -> ModuleType:
    def build() -> str:
        from flexid.derivation.regressor_classes import filter_functions

        return filter_functions(system, "State-variable filter on positions")

    return load_kernel("state_variable_filter", [system.digest], build, ["state_variable_filter"])
