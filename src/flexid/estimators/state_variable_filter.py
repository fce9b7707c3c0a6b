"""Least squares on positions through a state-variable filter: no accelerations, no velocities.

Every row v' = rᵀp + k is integrated twice over two sampling intervals, which turns v' into a second
difference of the position, and both sides are smoothed by the filter λ²/(s + λ)². What the filter
remembers from before the record is a combination of two known sequences, z^i and i z^i with its
pole z; both sides are projected on what these cannot explain, and p follows by least squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexid.arrays import FloatArray
from flexid.errors import SettingError
from flexid.estimators.block_sandwich import block_lengths
from flexid.estimators.row_signals import (
    check_velocities,
    fill_row_signals,
    sought_signals,
    wanted_signals,
)
from flexid.estimators.rowwise import RowwiseFit, fit_rows
from flexid.estimators.samples import Samples
from flexid.estimators.unknowns import Unknowns, unknowns_of
from flexid.models.parametric_system import ParametricSystem
from flexid.recording.recording import Hold

_MEMORY = 40.0  # time constants of the filter after which its past has vanished: exp(-40) = 4e-18


@dataclass(frozen=True, eq=False)
class LeastSquaresFit(RowwiseFit):
    """As `RowwiseFit`, of filtered accelerations."""

    filter_rate: float  # λ in 1/s


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
    check_velocities(recordings, usable, unknowns)
    wanted = wanted_signals(unknowns, usable)
    signals = filtered_signals(used, system, filter_rate, hold, wanted)
    lengths = [len(recording) - 2 for recording in used]
    regressors, left_hand_sides = sought_signals(signals, unknowns, usable, lengths)
    most = max(len(unknowns.names_of(row)) for row in system.rows)
    blocks = block_lengths(
        lengths, [recording.sample_time for recording in used], filter_rate, most
    )
    values, rows = fit_rows(unknowns, regressors, left_hand_sides)
    return LeastSquaresFit(unknowns.names, values, rows, tuple(blocks), hold, float(filter_rate))


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
    # Memory that nothing is written to takes no room: signals that are not wanted cost nothing.
    signals = np.zeros((len(system.coefficients) + len(system.rows), sum(equations)))
    first = 0
    for recording, count in zip(recordings, equations, strict=True):
        pole = float(np.exp(-filter_rate * recording.sample_time))
        fill_row_signals(signals, first, recording, system, hold, pole, wanted)
        past = min(count, memory(filter_rate, recording.sample_time))
        project_out_past(signals[:, first : first + past], pole)
        first += count
    return signals


def memory(filter_rate: float, sample_time: float) -> int:
    """Equations after which the filter has forgotten, to rounding, what was before them."""
    return int(np.ceil(_MEMORY / (filter_rate * sample_time))) + 2


def project_out_past(signals: FloatArray, pole: float) -> None:
    """Remove from each signal, in place, what the filter may remember: z^i and i z^i."""
    i = np.arange(signals.shape[1])
    past, _ = np.linalg.qr(np.column_stack((pole**i, i * pole**i)))
    signals -= (signals @ past) @ past.T
